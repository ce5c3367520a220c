"""Fan-out of independent items over processes of this machine or of a cluster."""
