"""From a folder of photos to metric surfaces of the objects in them."""
