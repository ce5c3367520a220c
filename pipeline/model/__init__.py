"""The generative model of two-object grasps: network, diffusion, how grasps and clouds are represented, checkpoints."""
