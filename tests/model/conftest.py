"""The tiny model of the tests of training."""

from tests.train.conftest import settings  # noqa: F401
