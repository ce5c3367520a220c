"""Small made-up tables with the columns of real ones."""

import io
from collections.abc import Sequence

import numpy as np
import pandas as pd
from PIL import Image

from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS
from pipeline.records.series import TrialSeries
from pipeline.records.tables import CANDIDATES, VALIDATED
from pipeline.report.conditions import Change, Tried, compared
from pipeline.report.counting import PairCounts, pair_counts
from pipeline.report.learned import Learned
from pipeline.report.rates import pair_merge
from pipeline.report.reconstructed import Reconstructed

REACH = [0.1, -0.5, 0.1, -2.5, 0.1, 1.9, 1.5]


def _filled(schema, rows: list[dict]) -> pd.DataFrame:
    return pd.DataFrame([{name: row.get(name) for name in schema.names} for row in rows], columns=schema.names)


def _candidate(index: int, style: str, name: str, rejected_by: str) -> dict:
    energies = {field: 0.1 for field in CANDIDATES.names if field.startswith("energy")}
    return energies | {
        "grasp_id": index,
        "object": name,
        "style": style,
        "fingers": "thumb+index",
        "position_object_hand": [0.1, 0.0, 0.0],
        "quaternion_object_hand": [1.0, 0.0, 0.0, 0.0],
        "q": [0.0] * 16,
        "contact_candidates": [0, 1],
        "contact_points": [[0.0, 0.0, 0.02], [0.0, 0.0, -0.02]],
        "contact_normals": [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
        "rejected_by": rejected_by,
    }


def candidates(style: str, name: str) -> pd.DataFrame:
    """Four chains, one of which fails the filter."""
    checks = ["", "", "distance", ""]
    return _filled(CANDIDATES, [_candidate(index, style, name, check) for index, check in enumerate(checks)])


def validated(style: str, name: str) -> pd.DataFrame:
    """The same chains after physics: one more fails."""
    checks = ["", "gravity:-x", "distance", ""]
    rows = [_candidate(index, style, name, check) for index, check in enumerate(checks)]
    for row in rows:
        row["approach_direction"] = [0.0, 0.6, 0.8] if row["rejected_by"] == "" else None
        row["contact_only_pass"] = None if row["rejected_by"] == "distance" else row["rejected_by"] == ""
    return _filled(VALIDATED, rows)


def merged(first: str, second: str, accepted: int = 2) -> pd.DataFrame:
    """``accepted`` accepted grasps and one rejected combination."""
    rows = []
    for index in range(accepted + 1):
        rows.append(
            {
                "merged_id": index,
                "object0": first,
                "object1": second,
                "grasp0_id": 0,
                "grasp1_id": 0,
                "fingers0": "thumb+index",
                "fingers1": "ring+palm",
                "q": np.full(16, 0.1 * index),
                "position_hand_object0": [0.08, 0.03, 0.05],
                "quaternion_hand_object0": [1.0, 0.0, 0.0, 0.0],
                "position_hand_object1": [0.06, -0.05, -0.02],
                "quaternion_hand_object1": [0.5, 0.5, 0.5, 0.5],
                "squeeze_q": [0.0] * 16,
                "rejected_by": "" if index < accepted else "hand_clearance",
            }
        )
    return _filled(PAIR_GRASPS, rows)


def quality(first: str, seconds: Sequence[str]) -> dict[str, dict]:
    """What `quality.json` holds of the pairs of one first object; the last pair was kept from training."""
    figures = {"penetration_mm_median": 0.5, "contact_distance_mm_median": 1.5, "object_overlap_mm_max": 0.0}
    return {
        second: {
            "trained": second != seconds[-1],
            "drawn": 9,
            "joint_violation_mean": 0.1,
            "raw": {name: 2 * value for name, value in figures.items()},
            "ranked": figures,
            "held_out": {"grasps": 4, "covered": 0.5, "nearest_mm_median": 12.0},
            "held_out_by_training": {"grasps": 4, "covered": 0.75, "nearest_mm_median": 11.0},
        }
        for second in seconds
    }


def learned(first: str, seconds: Sequence[str]) -> Learned:
    """A curve of two points; the last pair was kept from training."""
    return Learned(
        history=[
            {"step": step, "training_loss": 1 / step, "held_out_loss": 2 / step, "held_out_pair_loss": 3 / step}
            for step in (1, 2)
        ],
        quality={(first, second): own for second, own in quality(first, seconds).items()},
        samples=[pair_merge(first, second, merged(first, second)["rejected_by"]) for second in seconds],
    )


def trials(first: str, seconds: list[str], source: str = "synthesized") -> pd.DataFrame:
    """Three trials per pair: success, no plan, dropped."""
    outcomes = [("", True, True), ("plan second", False, False), ("dropped in hold", False, True)]
    rows = []
    for second in seconds:
        for index, (reason, success, success_10cm) in enumerate(outcomes):
            phases = ["settle", "close first", "hold"][: 3 - (reason == "plan second")]
            pose = [0.5, 0.1, 0.12, 1.0, 0.0, 0.0, 0.0]
            rows.append(
                {
                    "trial": index,
                    "source": source,
                    "object0": first,
                    "object1": second,
                    "merged_id": index % 2,
                    "seed": index,
                    "offset0": [0.0] * 3,
                    "offset1": [0.0] * 3,
                    "phase": phases[-1],
                    "success": success,
                    "success_10cm": success_10cm,
                    "reason": reason,
                    "planning_attempts": 1,
                    "steps": 100,
                    "snapshot_phases": phases,
                    "snapshot_robot_q": [REACH + [0.2] * 16] * len(phases),
                    "snapshot_pose0": [[0.5, -0.1, *pose[2:]]] * len(phases),
                    "snapshot_pose1": [pose] * len(phases),
                }
            )
    return _filled(PAIR_TRIALS, rows)


def counts(first: str, seconds: Sequence[str], source: str = "synthesized", accepted: int = 2) -> list[PairCounts]:
    """All pairs of one first object."""
    tried = trials(first, list(seconds), source)
    return [pair_counts(source, first, second, merged(first, second, accepted), tried) for second in seconds]


# What `metrics.json` of a rendered capture holds, as far as summary and page read it; the box has no known truth.
RECONSTRUCTION = {
    "kind": "rendered",
    "method": "plane_sweep",
    "photos": 24,
    "registered": 23,
    "registered_ratio": 23 / 24,
    "reprojection_px": 0.25,
    "tags_located": 6,
    "alignment_mm": 0.1,
    "camera_mm_mean": 0.1,
    "chamfer_mm_max": 0.5,
    "objects": {
        "can": {
            "points": 4000,
            "seen_share": 0.875,
            "volume_cm3": 310.0,
            "chamfer_mm": 0.5,
            "accuracy_mm": 0.45,
            "completeness_mm": 0.55,
            "f_score_2mm": 0.95,
        },
        "box": {"points": 3, "seen_share": 0.5, "volume_cm3": 2.0},
    },
}


def small_jpeg(grey: int) -> bytes:
    """A picture of 4 x 3 pixels."""
    target = io.BytesIO()
    Image.new("L", (4, 3), grey).save(target, format="JPEG")
    return target.getvalue()


def reconstructed() -> dict[str, Reconstructed]:
    """One capture with two pictures, no real ones."""
    return {"demo": Reconstructed(RECONSTRUCTION, {"photo_<0>": (small_jpeg(90), small_jpeg(200))})}


CHANGES = [Change("icy", "physics.object_friction", "0.9", "0.1", "Paper: <0.9>.")]


def tried(first: str, seconds: list[str], numbers: int = 3, standard: pd.DataFrame | None = None) -> Tried:
    """The condition `icy`: trial 0 with the last object fails, and trial 2 with the first succeeds."""
    rows = trials(first, seconds)
    fails = (rows["object1"] == seconds[-1]) & (rows["trial"] == 0)
    rows.loc[fails, ["success", "success_10cm"]] = False
    rows.loc[fails, "reason"] = "first slip"
    succeeds = (rows["object1"] == seconds[0]) & (rows["trial"] == 2)
    rows.loc[succeeds, ["success", "success_10cm"]] = True
    rows.loc[succeeds, "reason"] = ""
    return compared(
        TrialSeries("synthesized", "icy", "sapien"),
        rows[rows["trial"] < numbers],
        trials(first, seconds) if standard is None else standard,
        [(first, second) for second in seconds],
    )


def drawn_trials(friction: Sequence[float], success: Sequence[bool]) -> pd.DataFrame:
    """Trials that drew these frictions, and otherwise lengths that follow from their number."""
    number = np.arange(len(friction), dtype=np.float64)
    return pd.DataFrame(
        {
            "success": success,
            "friction": friction,
            "torque_limit": 0.35 + 0.01 * number,
            "latency": number % 3,
            "joint_errors": [np.full(23, 0.001 * n) for n in number],
            **{f"mass_factor{place}": 1.0 + number for place in (0, 1)},
            **{
                f"{name}{place}": [np.array([0.003, 0.004, 0.0]) * n for n in number]
                for name in ("centre_offset", "position_error", "rotation_error", "shove")
                for place in (0, 1)
            },
        }
    )
