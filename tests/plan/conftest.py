"""The two-object grasp of the tests of evaluation."""

from tests.evaluate.conftest import grasp, grasp_row, objects  # noqa: F401
