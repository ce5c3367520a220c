"""Features of the photos and which of them are the same: SIFT and its matching by COLMAP, on the CPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from PIL import Image
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.reconstruct.lens import Lens
from pipeline.reconstruct.photos import Photo
from pipeline.records.parameters.reconstruct import SparseParameters

# With more threads COLMAP's results differ from run to run: photos are numbered as their features get ready, and sums
# of the bundle adjustment round differently.
THREADS = 1
LARGEST_TURN = 65.0  # degrees between two photos beyond which SIFT does not find the same features again


@dataclass(frozen=True)
class Matches:
    """Features, and pairs of them that two photos share."""

    keypoints: dict[str, NDArray[np.float64]]  # per photo (n, 2) pixels, centres at .5
    pairs: tuple[tuple[str, str, NDArray[np.int64]], ...]  # two photos, and (k, 2) numbers of their features


def colmap_file(photo: Photo) -> str:
    """Return where COLMAP finds a photo: photos of one size in one folder, taken for one camera."""
    return f"{photo.size[0]}x{photo.size[1]}/{photo.name}.png"


def _write_photos(photos: Sequence[Photo], folder: Path) -> list[str]:
    """Write the photos and their masks; return the photos' names below ``folder/images``."""
    names = []
    for photo in photos:
        name = colmap_file(photo)
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


def pairs_within_reach(poses: Mapping[str, NDArray[np.float64]], names: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of photos that may show the same features: all, but those known to look from far apart.

    Args:
        poses: ``T_camera_scene`` (4, 4) of the photos for which it is known.
    """
    ahead = {name: T[2, :3] for name, T in poses.items()}
    least = np.cos(np.radians(LARGEST_TURN))
    return [
        (one, other)
        for at, one in enumerate(names)
        for other in names[:at]
        if one not in ahead or other not in ahead or float(ahead[one] @ ahead[other]) > least
    ]


def extract_and_match(
    folder: Path,
    photos: Sequence[Photo],
    lenses: Mapping[tuple[int, int], Lens],
    poses: Mapping[str, NDArray[np.float64]],
    settings: SparseParameters,
    seed: int,
) -> Matches:
    """Fill COLMAP's database in ``folder``, and return what it holds.

    Args:
        lenses: per size of photos what is known of the lens; sizes without are guessed by COLMAP.
        poses: see :func:`pairs_within_reach`.
    """
    database = folder / "database.db"
    names = _write_photos(photos, folder)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "SIMPLE_RADIAL"
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
    _tell_lenses(database, lenses)
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads, matching.use_gpu = THREADS, False
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    files = {photo.name: colmap_file(photo) for photo in photos}
    listed = folder / "pairs.txt"
    listed.write_text("".join(f"{files[a]} {files[b]}\n" for a, b in pairs_within_reach(poses, list(files))))
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = listed
    pycolmap.match_image_pairs(
        database,
        matching_options=matching,
        pairing_options=pairing,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )
    return _matches(database, {file: name for name, file in files.items()})


def _tell_lenses(database: Path, lenses: Mapping[tuple[int, int], Lens]) -> None:
    content = pycolmap.Database.open(database)
    for camera in content.read_all_cameras():
        lens = lenses.get((camera.width, camera.height))
        if lens is not None:
            known = lens.camera()
            known.camera_id, known.has_prior_focal_length = camera.camera_id, True
            content.update_camera(known)
    content.close()


def _matches(database: Path, names: Mapping[str, str]) -> Matches:
    content = pycolmap.Database.open(database)
    images = {image.image_id: names[image.name] for image in content.read_all_images()}
    keypoints = {}
    for number, name in images.items():
        found = np.asarray(content.read_keypoints(number), np.float64)
        keypoints[name] = found[:, :2] if found.size else np.zeros((0, 2))
    pairs = []
    for pair, geometry in zip(*content.read_two_view_geometries(), strict=True):
        both = pycolmap.pair_id_to_image_pair(pair)
        matches = np.asarray(geometry.inlier_matches, np.int64).reshape(-1, 2)
        if len(matches):
            pairs.append((images[both[0]], images[both[1]], matches))
    content.close()
    return Matches(keypoints, tuple(sorted(pairs, key=lambda item: item[:2])))


def tracks(matches: Matches, names: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.float64], int]:
    """Return the features that are one point: (m, 2) photo and point, (m, 2) pixels, and how many points.

    A point that one photo would show twice is left out: something in it was matched wrongly.
    """
    at = {name: number for number, name in enumerate(names)}
    counts = [len(matches.keypoints[name]) for name in names]
    start = np.concatenate([[0], np.cumsum(counts)])
    edges = [
        matched + [start[at[one]], start[at[other]]]
        for one, other, matched in matches.pairs
        if one in at and other in at
    ]
    both = np.concatenate([np.zeros((0, 2), np.int64), *edges])
    whole = int(start[-1])
    graph = coo_array((np.ones(len(both), np.int8), (both[:, 0], both[:, 1])), shape=(whole, whole))
    _, label = connected_components(graph, directed=False)
    nodes = np.unique(both)
    photo, label = np.searchsorted(start, nodes, side="right") - 1, label[nodes]
    twice = np.unique(np.stack([label, photo], axis=1), axis=0, return_counts=True)
    wrong = twice[0][twice[1] > 1, 0]
    good = ~np.isin(label, wrong)
    nodes, photo, label = nodes[good], photo[good], label[good]
    labels, point = np.unique(label, return_inverse=True)
    pixels = np.concatenate([np.zeros((0, 2)), *(matches.keypoints[name] for name in names)])[nodes]
    return np.stack([photo, point.reshape(-1)], axis=1), pixels, len(labels)
