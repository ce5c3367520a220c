"""Shared by this room's tests."""

# dvc binds its messages to the stderr of the moment it is first imported: not to one that ends with a test.
import dvc  # noqa: F401
