"""More than two objects in one hand, from single grasps to trials; stands above the stages and uses their functions."""
