"""How objects are called by their place in the order of picking: in the names of phases, and in reasons."""

ORDINALS = ("first", "second", "third", "fourth")  # no hand has room for more
