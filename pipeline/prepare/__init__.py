"""From a raw mesh or shape recipe to one solid in one canonical frame, and everything derived from it."""
