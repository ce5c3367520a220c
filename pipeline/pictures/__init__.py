"""Pictures without a GPU or a display: ray-cast renders of objects, hand and robot, and PNG files of them."""
