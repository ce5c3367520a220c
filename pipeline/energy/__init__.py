"""The grasp energy of a hand and an object, and its gradient, in one fused kernel; shared by synthesis and learning."""
