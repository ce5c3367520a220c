"""Published figures of SeqMultiGrasp (IROS 2025), to compare ours with; no more is known of its heat map."""

from __future__ import annotations

# By where the grasps came from: 64 pairs x 25 trials, both objects 20 cm up for 2 s.
MEAN_SUCCESS = {"synthesized": 0.827, "learned": 0.658}
# Known for synthesized grasps only.
MINIMUM_SUCCESS = {"synthesized": 0.56}  # worst cell of its heat map, a pair with the lemon
PERFECT_CELLS = {"synthesized": 4}  # cells at 100 %
PAIRS = 64
TRIALS_PER_PAIR = 25

# Table I: successes / batch of the single-grasp synthesis. Objects by the names of our catalogue.
SINGLE_GRASP_SUCCESS: dict[str, dict[str, float]] = {
    "pinch": {
        "plum": 0.004,
        "cube": 0.033,
        "duck": 0.020,
        "small_cylinder": 0.002,
        "bunny": 0.033,
        "lemon": 0.001,
        "train": 0.010,
        "bottle": 0.016,
    },
    "side": {
        "slender_cylinder": 0.033,
        "medicine_bottle_1": 0.017,
        "soda_can": 0.021,
        "soup_can": 0.041,
        "boxed_beverage": 0.056,
        "shaving_foam": 0.012,
        "medicine_bottle_2": 0.019,
        "canned_meat": 0.039,
    },
}
