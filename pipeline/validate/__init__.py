"""Stage validate: which candidates survive physics."""
