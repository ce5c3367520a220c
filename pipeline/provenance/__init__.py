"""Which code a command runs: the modules that it imports, what they say, and one fingerprint of all."""
