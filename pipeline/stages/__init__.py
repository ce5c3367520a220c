"""How a stage runs: its items and their fingerprints, its seeds, its cost, and how results lie in its output."""
