"""The finished run is shared with the tests of the whole pipeline."""

from tests.pipeline.conftest import finished, workspace  # noqa: F401
