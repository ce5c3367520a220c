"""Grasps from outside: read in the formats of others, tested as ours are, and shown with every verdict."""
