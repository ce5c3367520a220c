"""Camera poses from photos alone: SIFT features, exhaustive matching and mapping by COLMAP, on the CPU."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray
from PIL import Image

from pipeline.reconstruct.photos import Photo
from pipeline.records.captures import Intrinsics
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SparseParameters

# With more threads COLMAP's results differ from run to run: photos are numbered as their features get ready, and sums
# of the bundle adjustment round differently.
THREADS = 1


@dataclass(frozen=True)
class SparseView:
    """One photo whose pose was found; the world frame and its scale are arbitrary."""

    photo: Photo
    camera: Any  # pycolmap.Camera
    T_camera_world: NDArray[np.float64]  # (4, 4)

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return undistorted coordinates (n, 2) at depth 1 of ``pixels`` (n, 2), pixel centres at .5."""
        return np.asarray(self.camera.cam_from_img(np.ascontiguousarray(pixels, np.float64)))


@dataclass(frozen=True)
class SparseModel:
    """What COLMAP found."""

    views: tuple[SparseView, ...]  # in the order of the photos' names
    points: NDArray[np.float64]  # (n, 3), world frame
    reprojection: float  # mean, pixels
    photos: int  # how many there were


def _file(photo: Photo) -> str:
    """Return where COLMAP finds a photo: photos of one size in one folder, taken for one camera."""
    return f"{photo.size[0]}x{photo.size[1]}/{photo.name}.png"


def _write_photos(photos: Sequence[Photo], folder: Path) -> list[str]:
    """Write the photos and their masks; return the photos' names below ``folder/images``."""
    names = []
    for photo in photos:
        name = _file(photo)
        for kind, pixels in (("images", photo.grey), ("masks", photo.usable)):
            if pixels is None:
                continue
            target = folder / kind / (name if kind == "images" else f"{name}.png")
            target.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.asarray(pixels, np.uint8) * (255 if kind == "masks" else 1)).save(
                target, compress_level=1
            )
        names.append(name)
    return names


def _extract_and_match(
    folder: Path, names: list[str], intrinsics: Intrinsics | None, settings: SparseParameters, seed: int
) -> None:

    database = folder / "database.db"
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = settings.camera_model
    if intrinsics is not None:
        reader.camera_model = intrinsics.model
        reader.camera_params = ",".join(str(value) for value in intrinsics.parameters)
    if (folder / "masks").exists():
        reader.mask_path = folder / "masks"
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.num_threads, extraction.use_gpu = THREADS, False
    extraction.sift.max_num_features = settings.features
    pycolmap.extract_features(
        database,
        folder / "images",
        image_names=names,
        camera_mode=pycolmap.CameraMode.PER_FOLDER,
        reader_options=reader,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads, matching.use_gpu = THREADS, False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pycolmap.match_exhaustive(
        database, matching_options=matching, verification_options=verification, device=pycolmap.Device.cpu
    )


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


def _views(model: Any, photos: Sequence[Photo]) -> tuple[SparseView, ...]:
    """Return the photos of a model of COLMAP that have a pose, in the order of their names."""
    by_file = {_file(photo): photo for photo in photos}
    views = []
    for image in model.images.values():
        if image.has_pose:
            T = np.eye(4)
            T[:3] = image.cam_from_world().matrix()
            views.append(SparseView(by_file[image.name], model.camera(image.camera_id), T))
    return tuple(sorted(views, key=lambda view: view.photo.name))


def sparse_model(
    photos: Sequence[Photo],
    intrinsics: Intrinsics | None,
    settings: SparseParameters,
    seed: int,
) -> SparseModel:
    """Find the poses of all photos.

    Raises:
        UserError: too few photos fit together, or ``intrinsics.yaml`` is for photos of another size.
    """
    if intrinsics is not None:
        intrinsics.check_sizes({photo.name: photo.file_size for photo in photos})
        intrinsics = intrinsics.shrunk(photos[0].times)  # the sizes are the same, so the others' is too
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(seed)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        names = _write_photos(photos, folder)
        _extract_and_match(folder, names, intrinsics, settings, seed)
        models = _map(folder, settings, intrinsics is not None, seed)
    best = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
    registered = best.num_reg_images() if best is not None else 0
    if best is None or registered < max(3, settings.least_registered * len(photos)):
        raise UserError(
            f"only {registered} of {len(photos)} photos fit together; take more of them with smaller steps between, "
            "sharp, and with something textured (a printed cloth) on the table."
        )
    points = np.array([point.xyz for _, point in sorted(best.points3D.items())], np.float64).reshape(-1, 3)
    return SparseModel(_views(best, photos), points, float(best.compute_mean_reprojection_error()), len(photos))
