"""Grasps of objects as photos show them, carried over to the true objects on which the robot tries them.

The frame of a reconstructed object has its origin at the centre of mass of what was reconstructed, and lies where the
photos put it; both differ a little from the frame of the true object. How they lie to each other follows from the
capture, in which both have a place: the photos' errors stay errors, and nothing is fitted to make them smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.grasps import SequenceGrasp
from pipeline.records import paths
from pipeline.records.captures import read_truth
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.records.reading import read_vertices
from pipeline.records.reconstructions import load_reconstructed_object

LARGEST_DIFFERENCE = 1e-4  # m between corners of the same mesh; files hold single precision


def pose_of_same_mesh(vertices: NDArray[np.float64], placed: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the pose ``T`` (4, 4) with placed = T vertices, both (V, 3), or None if there is none.

    Least squares over rotations (Kabsch 1976).
    """
    if vertices.shape != placed.shape:
        return None
    middle, there = vertices.mean(axis=0), placed.mean(axis=0)
    u, _, vt = np.linalg.svd((placed - there).T @ (vertices - middle))
    R = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, there - R @ middle
    return T if np.abs(transform_points(T, vertices) - placed).max() <= LARGEST_DIFFERENCE else None


def true_from_reconstructed(capture: str, prepared: PreparedObject) -> NDArray[np.float64]:
    """Return ``T_true_reconstructed`` (4, 4) of an object in a rendered capture.

    Raises:
        UserError: the reconstruction or the truth is missing, or shows another object than the prepared one.
    """
    reconstructed = load_reconstructed_object(capture, prepared.name)
    truth = read_truth(paths.capture_folder(capture))
    source = truth.surfaces.get(prepared.name) if truth else None
    mend = "run `dvc repro capture`"
    if source is None:
        raise UserError(f"{paths.capture_folder(capture)}/gt does not hold {prepared.name}.ply; {mend}.")
    T_scene_true = pose_of_same_mesh(prepared.vertices, read_vertices(source, mend))
    if T_scene_true is None:
        raise UserError(f"{source} is not the object in {paths.prepared_folder(prepared.name)}; {mend}.")
    return inverse_pose(T_scene_true) @ reconstructed.T_scene_object


def in_true_frames(grasp: SequenceGrasp, T_true_object: Sequence[NDArray[np.float64]]) -> SequenceGrasp:
    """Return a grasp, given in the frames of reconstructed objects, in those of the true ones.

    Args:
        T_true_object: (4, 4) from :func:`true_from_reconstructed`, of each object.
    """
    picks = tuple(
        replace(
            pick,
            T_hand_object=pick.T_hand_object @ inverse_pose(T),
            approach_direction=T[:3, :3] @ pick.approach_direction,
        )
        for pick, T in zip(grasp.picks, T_true_object, strict=True)
    )
    return replace(grasp, picks=picks)
