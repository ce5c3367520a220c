"""Several grasps in one hand: how they join, what they must not touch, how the hand comes to every object."""
