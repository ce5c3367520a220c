"""Stage evaluate: the whole sequence with a simulated robot."""
