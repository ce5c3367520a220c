"""Sequential multi-object grasping as a reproducible data pipeline."""
