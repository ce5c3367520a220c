"""Captures without a camera: rendered photo folders of prepared objects, and the printable sheet of tags."""
