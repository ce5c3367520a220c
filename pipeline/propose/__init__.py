"""Two-object grasps for two files of your own: from the trained model, by synthesis, or both."""
