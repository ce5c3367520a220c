"""Camera poses from features alone, by COLMAP's mapping: for photos of which too few show tags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from pipeline.reconstruct.features import THREADS, colmap_file
from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SparseParameters


@dataclass(frozen=True)
class Mapped:
    """What COLMAP found; its world frame and scale are arbitrary."""

    poses: dict[str, NDArray[np.float64]]  # per photo ``T_camera_world`` (4, 4)
    lenses: dict[tuple[int, int], Lens]  # per size


def _map(folder: Path, settings: SparseParameters, calibrated: bool, seed: int) -> dict[int, Any]:
    """Return COLMAP's models."""
    database, images, target = folder / "database.db", folder / "images", folder / "sparse"
    target.mkdir()
    if settings.mapper == "global":
        whole = pycolmap.GlobalPipelineOptions()
        whole.num_threads, whole.random_seed = THREADS, seed
        if calibrated:
            adjustment = whole.mapper.bundle_adjustment
            adjustment.refine_focal_length = adjustment.refine_extra_params = False
        return dict(pycolmap.global_mapping(database, images, target, whole))
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed, options.multiple_models = THREADS, seed, True
    options.extract_colors = False
    if calibrated:
        options.ba_refine_focal_length = options.ba_refine_extra_params = False
    return dict(pycolmap.incremental_mapping(database, images, target, options))


def _lens(camera: Any) -> Lens:
    """Return the lens of COLMAP's camera, of either model that is in the database."""
    lens = Lens.guessed(camera.width, camera.height, float(camera.mean_focal_length()))
    if camera.model_name == "SIMPLE_RADIAL":
        return lens.with_values(np.array([lens.focal, camera.params[3], 0, 0, 0]))
    return lens.with_values(np.array([lens.focal, *camera.params[4:8]]))


def mapped(folder: Path, photos: Sequence[Photo], settings: SparseParameters, calibrated: bool, seed: int) -> Mapped:
    """Return poses of the photos whose features are in COLMAP's database in ``folder``.

    Raises:
        UserError: too few photos fit together.
    """
    models = _map(folder, settings, calibrated, seed)
    best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
    registered = best.num_reg_images() if best is not None else 0
    if best is None or registered < max(3, settings.least_registered * len(photos)):
        raise UserError(
            f"only {registered} of {len(photos)} photos fit together; take more of them with smaller steps between, "
            "sharp, and with something textured (a printed cloth) on the table."
        )
    names = {colmap_file(photo): photo.name for photo in photos}
    poses, lenses = {}, {}
    for image in best.images.values():
        if image.has_pose:
            T = np.eye(4)
            T[:3] = image.cam_from_world().matrix()
            poses[names[image.name]] = T
            camera = best.camera(image.camera_id)
            lenses[camera.width, camera.height] = _lens(camera)
    return Mapped(poses, lenses)
