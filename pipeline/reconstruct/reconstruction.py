"""The whole way from a capture to metric objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers
from pipeline.reconstruct.accuracy import Accuracy, compare
from pipeline.reconstruct.alignment import Alignment
from pipeline.reconstruct.cameras import Cameras, find_cameras, find_cameras_by_length
from pipeline.reconstruct.dense import DenseObject, dense_objects
from pipeline.reconstruct.detection import Seen, family_seen, seen_tags
from pipeline.reconstruct.fusion import support_shares
from pipeline.reconstruct.normal_maps import normal_files, read_normals, shrunk_normals
from pipeline.reconstruct.photos import Photo, read_grey, read_photos
from pipeline.reconstruct.surface import Surface, samples_of
from pipeline.reconstruct.tags import check_sightings
from pipeline.reconstruct.views import View, undistort_all, undistorted_normals
from pipeline.records.captures import Capture, KnownLength, SceneObject, Truth
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry_file
from pipeline.records.parameters.reconstruct import ReconstructParameters
from pipeline.records.reconstructions import ReconstructedObject
from pipeline.records.tag_layouts import TagLayout

FAMILY_PHOTOS = 4  # searched for other families


@dataclass(frozen=True)
class Reconstruction:
    """What was found, and how well it fits."""

    objects: dict[str, ReconstructedObject]
    dense: dict[str, DenseObject]
    views: tuple[View, ...]
    cameras: Cameras
    normal_prior: bool
    supported: dict[str, NDArray[np.int64]]  # per object and sample of its surface how many photos measured it


def in_object_frame(name: str, item: SceneObject, found: DenseObject, count: int, seed: int) -> ReconstructedObject:
    """Return the surface and its samples with the centre of mass as origin, turned as the placement says."""
    surface = found.surface
    samples = samples_of(surface, found.points.positions, count, seed)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    T = item.matrix(0.0)
    T[:3, 3] = mesh.center_mass
    R = T[:3, :3]
    return ReconstructedObject(
        name=name,
        # float32, as files hold no more.
        vertices=((surface.vertices - T[:3, 3]) @ R).astype(np.float32).astype(np.float64),
        faces=surface.faces,
        points=(samples.points - T[:3, 3]) @ R,
        normals=samples.normals @ R,
        seen=samples.seen,
        T_scene_object=T,
        volume=float(mesh.volume),
    )


def check_seen(objects: Mapping[str, ReconstructedObject], least: float) -> None:
    """Refuse an object most of which would be a guess.

    Raises:
        UserError: less than the share ``least`` of its surface was measured.
    """
    for name, item in objects.items():
        if item.seen.mean() < least:
            raise UserError(
                f"{name}: only {item.seen.mean():.0%} of its surface was measured; give it some texture (stickers, "
                "powder), and take sharper photos of it, from all sides."
            )


def tags_in_photos(capture: Capture, layout: TagLayout, photos: Sequence[Photo]) -> dict[str, Seen]:
    """Return per photo the tags of ``layout`` in it, sought in the photo at its full size.

    Raises:
        UserError: the photos show tags of another family than ``tags.yaml`` says, and none of that.
    """
    seen = {}
    for photo, path in zip(photos, capture.images, strict=True):
        grey = photo.grey if photo.times == 1 else read_grey(path)
        seen[photo.name] = seen_tags(grey, layout, photo.times)
    if not any(its.tags or its.repeated for its in seen.values()):
        few = [photo.grey for photo in photos[:: max(len(photos) // FAMILY_PHOTOS, 1)]]
        family = family_seen(few, layout.family)
        if family is not None:
            raise UserError(
                f"{capture.folder}/tags.yaml says that the tags are of the family {layout.family}, but the "
                f"photos show {family}; write that there."
            )
    return seen


def _cameras_of(capture: Capture, photos: Sequence[Photo], settings: ReconstructParameters, seed: int) -> Cameras:
    if isinstance(capture.tags, KnownLength):
        return find_cameras_by_length(photos, capture.tags, capture.intrinsics, settings, seed)
    seen = tags_in_photos(capture, capture.tags, photos)
    check_sightings({name: its.tags for name, its in seen.items()}, capture.tags, settings.alignment)
    return find_cameras(photos, seen, capture.tags, capture.scene, capture.intrinsics, settings, seed)


def reconstruct(capture: Capture, settings: ReconstructParameters, seed: int, workers: Workers) -> Reconstruction:
    """Return the objects of a capture, metric.

    Raises:
        UserError: the photos, the tags, an object or the machine do not allow it; the text says which and what to do.
    """
    if settings.method == "2dgs":
        from pipeline.reconstruct.splatting import check_device  # torch is for this method alone

        check_device(settings.splat.device)
    photos = read_photos(capture, settings.largest_side)
    normals = normal_files(capture, photos) if settings.method == "2dgs" else {}
    cameras = _cameras_of(capture, photos, settings, seed)
    views = undistort_all(cameras.views)
    dense = dense_objects(views, capture.scene, settings.sweep, settings.surface, workers)
    priors = {
        view.photo.name: undistorted_normals(
            view, shrunk_normals(read_normals(normals[view.photo.name]), view.photo.times)
        )
        for view in cameras.views
        if view.photo.name in normals
    }
    if settings.method == "2dgs":
        from pipeline.reconstruct.splatting import splatted_objects

        dense = splatted_objects(views, dense, priors, capture.scene, settings, seed, workers)
    objects = {
        name: in_object_frame(name, capture.scene.objects[name], found, settings.surface.points, seed)
        for name, found in dense.items()
    }
    check_seen(objects, settings.surface.least_seen)
    supported = {
        name: support_shares(
            item.points @ item.T_scene_object[:3, :3].T + item.T_scene_object[:3, 3],
            views,
            dense[name].maps,
            settings.sweep.agreement,
        )
        for name, item in objects.items()
    }
    return Reconstruction(objects, dense, tuple(views), cameras, bool(priors), supported)


def cameras_of(views: Sequence[View]) -> dict[str, Any]:
    """Return the cameras as they are stored."""
    return {
        view.name: {
            "width": view.image.shape[1],
            "height": view.image.shape[0],
            "K": view.K.tolist(),
            "T_camera_scene": view.T_camera_scene.tolist(),
        }
        for view in views
    }


def true_surfaces(truth: Truth | None) -> dict[str, Surface]:
    """Return the true surfaces of a capture by the names of their objects.

    Raises:
        UserError: one of them cannot be read, or has no triangles.
    """
    found = {}
    for name, path in truth.surfaces.items() if truth is not None else ():
        try:
            mesh = read_geometry_file(path)
            found[name] = Surface(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))
        except (ValueError, OSError, LookupError, AttributeError, TypeError) as error:
            raise UserError(f"{path} is no readable mesh ({error}); mend or remove it.") from error
        if not len(found[name].faces) or not np.isfinite(found[name].vertices).all():
            raise UserError(f"{path} holds no surface of triangles; mend or remove it.")
    return found


def accuracies(dense: Mapping[str, DenseObject], true: Mapping[str, Surface]) -> dict[str, Accuracy]:
    """Return how far each object whose true surface is known is from it."""
    return {name: compare(dense[name].surface, surface) for name, surface in true.items() if name in dense}


def _camera_errors(views: Sequence[View], truth: Truth) -> dict[str, float]:
    """Return how far the camera centres are from where they were, mm, as far as that is known."""
    known = [(view.centre, truth.camera_centres[view.name]) for view in views if view.name in truth.camera_centres]
    if not known:
        return {}
    off = np.array([1000 * np.linalg.norm(found - true) for found, true in known])
    return {"camera_mm_mean": float(off.mean()), "camera_mm_max": float(off.max())}


def _shares(counts: NDArray[np.int64]) -> dict[str, float]:
    """Return the shares of a surface that no, one or two, three to five, and more photos measured."""
    limits = {"0": (0, 0), "1-2": (1, 2), "3-5": (3, 5), "6+": (6, np.inf)}
    return {name: float(((counts >= low) & (counts <= high)).mean()) for name, (low, high) in limits.items()}


def _alignment_figures(alignment: Alignment) -> dict[str, float]:
    return {
        "corners_used": alignment.corners_used,
        "alignment_mm": 1000 * alignment.residual,
        "alignment_mm_max": 1000 * alignment.largest_residual,
    }


def metrics_of(result: Reconstruction, method: str, truth: Truth | None) -> dict[str, Any]:
    """Return the figures of ``metrics.json``; lengths in mm, as people say them.

    Raises:
        UserError: see :func:`true_surfaces`.
    """
    cameras, alignment = result.cameras, result.cameras.alignment
    metrics: dict[str, Any] = {
        "method": method,
        "normal_prior": "folder" if result.normal_prior else "none",
        "kind": "rendered" if truth is not None and truth.rendered else "photos",
        "photos": cameras.photos,
        "registered": len(result.views),
        "registered_ratio": len(result.views) / cameras.photos,
        "dropped": cameras.dropped,
        "sparse_points": len(cameras.points),
        "reprojection_px": cameras.reprojection,
        "tags_located": len(alignment.tags) if alignment else 0,
        **({} if alignment is None else _alignment_figures(alignment)),
        "cameras": cameras.facts,
        "objects": {},
    }
    for name, item in result.objects.items():
        metrics["objects"][name] = {
            "points": len(result.dense[name].points.positions),
            "supported_by": _shares(result.supported[name]),
            "extents_mm": (1000 * np.ptp(item.vertices, axis=0)).tolist(),
            "seen_through": result.dense[name].points.seen_through,
            "seen_share": float(item.seen.mean()),
            "volume_cm3": 1e6 * item.volume,
        }
    if truth is not None:
        metrics |= _camera_errors(result.views, truth)
        found = accuracies(result.dense, true_surfaces(truth))
        for name, accuracy in found.items():
            metrics["objects"][name] |= {
                "chamfer_mm": 1000 * accuracy.chamfer,
                "accuracy_mm": 1000 * accuracy.accuracy,
                "completeness_mm": 1000 * accuracy.completeness,
                "completeness_mm_p95": 1000 * accuracy.completeness_p95,
                "f_score_2mm": accuracy.f_score,
            }
        if found:
            metrics["chamfer_mm_max"] = 1000 * max(accuracy.chamfer for accuracy in found.values())
    return metrics
