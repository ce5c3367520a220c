"""Stage train: fits the generative model to merged grasps."""
