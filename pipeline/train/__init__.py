"""A generative model of two-object grasps, conditioned on the clouds of both objects."""
