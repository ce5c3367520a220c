"""Browses everything that the pipeline made, in a browser: objects, grasps by outcome, trials, reconstructions."""
