"""Ray-cast pictures of objects, hands and robots, without any graphics driver."""
