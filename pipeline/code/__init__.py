"""A fingerprint of the code of every command, so that a stage runs again when its own code changed."""
