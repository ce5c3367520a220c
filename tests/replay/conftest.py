"""The trial of the tests of evaluation."""

from tests.evaluate.conftest import grasp, grasp_row, objects, trial_input  # noqa: F401
