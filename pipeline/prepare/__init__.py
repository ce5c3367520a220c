"""Stage prepare: from a raw mesh to everything the other stages need of an object."""
