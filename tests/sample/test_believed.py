"""Samples of what is believed, in the frames of the objects."""

import numpy as np
import pandas as pd

from pipeline.records.poses import pose_matrix
from pipeline.sample.believed import table_in_frames


def test_a_row_is_carried_over_to_the_true_frame():
    quarter = np.array([[0.0, -1, 0, 0.01], [1, 0, 0, 0.02], [0, 0, 1, 0.03], [0, 0, 0, 1]])
    row = {
        "positions_hand_object": [[0.1, 0, 0], [0, 0.1, 0]],
        "quaternions_hand_object": [[1.0, 0, 0, 0], [1.0, 0, 0, 0]],
        "approach_directions": [[1.0, 0, 0]],  # those of later objects are not known
    }
    found = table_in_frames(pd.DataFrame([row]), [quarter, np.eye(4)]).iloc[0]
    T = pose_matrix(found["positions_hand_object"][0], found["quaternions_hand_object"][0])
    np.testing.assert_allclose(T @ quarter @ [0, 0, 0, 1], [0.1, 0, 0, 1], atol=1e-12)  # the believed origin
    np.testing.assert_allclose(found["approach_directions"][0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(found["positions_hand_object"][1], [0, 0.1, 0], atol=1e-12)
