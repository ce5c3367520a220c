"""The shape of one solid: distances, surface samples, convex parts, mass, and its frame."""
