"""Browses everything that the pipeline made: objects, grasps with their reject reasons, trials, reconstructions."""
