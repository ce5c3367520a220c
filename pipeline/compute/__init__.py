"""Fan-out of independent items over processes (or, later, a cluster)."""
