"""2D Gaussian splatting (Huang et al. 2024), started from the points of the plane sweep: another way to the surface.

Every object is optimised alone, on the pixels in which it is seen: the loss is the published one (0.8 L1 + 0.2 D-SSIM,
depth distortion, consistency of rendered normals with the normals of the rendered depth), plus a pull towards covering
the object's pixels, plus, where the capture has normal maps, their agreement with the rendered normals (the prior that
the paper takes from StableNormal). Photos may differ in exposure: each is compared up to a factor. Rendered depths are
fused in a truncated signed-distance field; its surface is closed as that of the sweep is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.compute.fan_out import Workers, fan_out
from pipeline.compute.warp import warp
from pipeline.reconstruct.dense import LEAST_VIEWS, DenseObject
from pipeline.reconstruct.fusion import Points, thinned
from pipeline.reconstruct.plane_sweep import Window
from pipeline.reconstruct.rasterise import Target, rasterise
from pipeline.reconstruct.surface import Surface, oriented, poisson_surface
from pipeline.reconstruct.tsdf import DistanceField
from pipeline.reconstruct.views import View
from pipeline.reconstruct.visibility import Bodies
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import ReconstructParameters, SplatParameters
from pipeline.stages.seeds import item_generator

# Adam's steps: metres for centres, radians about, logarithms, logits.
RATES = {"centre": 2e-5, "rotation": 2e-3, "extent": 5e-3, "opacity": 2e-2, "brightness": 5e-3}
INITIAL_OPACITY = 0.8
LEAST_PIXELS = 50  # that show the object; a photo with fewer is left out
WEIGHT_COVER = 0.05  # of the light that passes through where the object is
LEAST_COVER = 0.5  # of a pixel whose depth is fused
FOLLOWED_ANGLE = 85.0  # degrees between ray and normal beyond which a pixel is not used
LARGEST_SLOPE = 0.2  # cosine between ray and normal below which a rendered depth is not fused


@dataclass(frozen=True)
class SplatView:
    """What one photo shows of one object, shrunk."""

    target: Target
    T_camera_scene: NDArray[np.float64]  # (4, 4)
    image: NDArray[np.float32]  # (h, w)
    shows: NDArray[np.bool_]  # (h, w) pixels in which the object is seen
    prior: NDArray[np.float32] | None  # (h, w, 3) unit normals in the camera frame, 0 where unknown


@dataclass
class Splats:
    """The parameters that are optimised."""

    centre: torch.Tensor  # (n, 3), m, scene frame
    rotation: torch.Tensor  # (n, 4) quaternion wxyz, not normalised
    extent: torch.Tensor  # (n, 2) logarithm of m
    opacity: torch.Tensor  # (n,) logit
    brightness: torch.Tensor  # (n,)

    def named(self) -> dict[str, torch.Tensor]:
        """Return all parameters by name."""
        return {name: getattr(self, name) for name in RATES}


def rotation_matrices(quaternions: torch.Tensor) -> torch.Tensor:
    """Return (n, 3, 3) of quaternions wxyz (n, 4) of any length."""
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=1).unbind(1)
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(rows, 1).reshape(-1, 3, 3)


def shrunk_view(
    view: View, window: Window, bodies: Bodies, own: int, scale: float, prior: NDArray[np.float32] | None
) -> SplatView:
    """Return one window of a photo, shrunk by ``scale``, and where body number ``own`` is seen there."""
    height, width = max(round(window.height * scale), 8), max(round(window.width * scale), 8)
    # Whole pixels: the small window ends up to half a pixel beside the large one, at the same scale in both directions.
    grid = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1) / scale
    pixels = grid.reshape(-1, 2) + [window.left, window.top]
    blurred = cv2.GaussianBlur(view.image, (0, 0), 0.35 / scale) if scale < 1 else view.image
    place = (pixels - 0.5).astype(np.float32).reshape(height, width, 2)
    image = cv2.remap(blurred, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(view.K).T
    mine, _ = bodies.depth(own, view.centre, rays @ view.T_camera_scene[:3, :3], FOLLOWED_ANGLE)
    shows = (mine > 0).reshape(height, width)
    if view.usable is not None:
        index = np.clip(place.round().astype(int), 0, np.array(view.image.shape)[::-1] - 1)
        shows &= view.usable[index[..., 1], index[..., 0]]
    if prior is not None:
        prior = np.asarray(cv2.remap(prior, place[..., 0], place[..., 1], cv2.INTER_NEAREST), np.float32)
    known = mine[mine > 0]
    near, far = (float(known.min()), float(known.max())) if len(known) else (0.5, 1.0)
    target = Target(
        width=width,
        height=height,
        focal=float(view.K[0, 0]) * scale,
        centre_x=float(view.K[0, 2] - window.left) * scale,
        centre_y=float(view.K[1, 2] - window.top) * scale,
        near=near - 0.005,
        far=far + 0.005,
    )
    return SplatView(target, view.T_camera_scene, np.ascontiguousarray(image), shows, prior)


def initial_splats(points: Points, spacing: float, views: Sequence[SplatView], device: str) -> Splats:
    """Return flat splats on the points of the sweep, as wide as their spacing, as bright as the photos."""
    cloud = oriented(thinned(points, spacing))
    positions, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    # The rotation that turns z into the normal: half the angle about z x normal.
    quaternion = np.column_stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(len(normals))])
    flipped = normals[:, 2] < -0.999
    quaternion[flipped] = [0, 1, 0, 0]
    total, weight = np.zeros(len(positions)), np.full(len(positions), 1e-6)
    for view in views:
        R, t = view.T_camera_scene[:3, :3], view.T_camera_scene[:3, 3]
        local = positions @ R.T + t
        facing = -((normals @ R.T) * local).sum(axis=1) / np.linalg.norm(local, axis=1)
        column = (view.target.focal * local[:, 0] / local[:, 2] + view.target.centre_x).astype(int)
        row = (view.target.focal * local[:, 1] / local[:, 2] + view.target.centre_y).astype(int)
        good = (facing > 0.3) & (column >= 0) & (column < view.target.width) & (row >= 0) & (row < view.target.height)
        good[good] &= view.shows[row[good], column[good]]
        total[good] += facing[good] * view.image[row[good], column[good]]
        weight[good] += facing[good]
    count = len(positions)

    def tensor(values: NDArray[np.float64]) -> torch.Tensor:
        return torch.tensor(values, dtype=torch.float32, device=device).requires_grad_()

    return Splats(
        tensor(positions),
        tensor(quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)),
        tensor(np.full((count, 2), np.log(0.6 * spacing))),
        tensor(np.full(count, np.log(INITIAL_OPACITY / (1 - INITIAL_OPACITY)))),
        tensor(total / weight),
    )


def draw(splats: Splats, view: SplatView, device: str) -> torch.Tensor:
    """Return the outputs of the rasteriser (h, w, 8) for one view."""
    T = torch.tensor(view.T_camera_scene, dtype=torch.float32, device=splats.centre.device)
    axes = T[:3, :3] @ rotation_matrices(splats.rotation)
    return rasterise(
        view.target,
        device,
        splats.centre @ T[:3, :3].T + T[:3, 3],
        axes[:, :, 0].contiguous(),
        axes[:, :, 1].contiguous(),
        axes[:, :, 2].contiguous(),
        torch.exp(splats.extent),
        torch.sigmoid(splats.opacity),
        splats.brightness,
    )


def normals_of_depth(depth: torch.Tensor, target: Target) -> torch.Tensor:
    """Return unit normals (h, w, 3) of a depth picture, camera frame, turned to the camera; 0 on the border."""
    rows, columns = torch.meshgrid(
        torch.arange(target.height, device=depth.device), torch.arange(target.width, device=depth.device), indexing="ij"
    )
    x = (columns + 0.5 - target.centre_x) / target.focal
    y = (rows + 0.5 - target.centre_y) / target.focal
    points = torch.stack([x, y, torch.ones_like(x)], -1) * depth[..., None]
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    normal = torch.nn.functional.normalize(torch.cross(down, across, dim=-1), dim=-1, eps=1e-12)
    return torch.nn.functional.pad(normal, (0, 0, 1, 1, 1, 1))


def _dissimilarity(one: torch.Tensor, other: torch.Tensor, shows: torch.Tensor) -> torch.Tensor:
    """Return 1 - SSIM with windows of 7 pixels, mean over the pixels shown."""

    def mean(values: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.avg_pool2d(values[None, None], 7, 1, 3, count_include_pad=False)[0, 0]

    a, b = mean(one), mean(other)
    va, vb, ab = mean(one * one) - a * a, mean(other * other) - b * b, mean(one * other) - a * b
    similarity = (2 * a * b + 1e-4) * (2 * ab + 9e-4) / ((a * a + b * b + 1e-4) * (va + vb + 9e-4))
    return (1 - similarity)[shows].mean()


def loss_of(outputs: torch.Tensor, view: SplatView, settings: SplatParameters) -> torch.Tensor:
    """Return the loss of one drawn view."""
    device = outputs.device
    shows = torch.tensor(view.shows, device=device)
    photo = torch.tensor(view.image, device=device)
    brightness, cover = outputs[..., 0], outputs[..., 1]
    drawn = brightness / (cover + 1e-3)
    with torch.no_grad():  # photos may differ in exposure
        gain = (photo * drawn)[shows].sum() / (drawn * drawn)[shows].sum().clamp_min(1e-6)
    drawn = torch.where(shows, drawn * gain, photo)
    loss = 0.8 * (drawn - photo)[shows].abs().mean() + 0.2 * _dissimilarity(drawn, photo, shows)
    loss = loss + WEIGHT_COVER * (1 - cover)[shows].mean()
    loss = loss + settings.weight_distortion * outputs[..., 6][shows].mean()
    rendered = outputs[..., 3:6]
    if settings.weight_normal:
        surface = normals_of_depth(outputs[..., 2] / (cover + 1e-6), view.target)
        inner = (
            shows
            & torch.roll(shows, 1, 0)
            & torch.roll(shows, -1, 0)
            & torch.roll(shows, 1, 1)
            & torch.roll(shows, -1, 1)
        )
        loss = loss + settings.weight_normal * (cover - (rendered * surface).sum(-1))[
            inner
        ].sum() / inner.sum().clamp_min(1)
    if view.prior is not None and settings.weight_prior:
        prior = torch.tensor(view.prior, device=device)
        known = shows & (prior.abs().sum(-1) > 0.5)
        loss = loss + settings.weight_prior * (cover - (rendered * prior).sum(-1))[known].sum() / known.sum().clamp_min(
            1
        )
    return loss


def train(
    splats: Splats, views: Sequence[SplatView], settings: SplatParameters, random: np.random.Generator
) -> list[float]:
    """Optimise the splats in place, one view a step, and return the losses."""
    groups = [{"params": [tensor], "lr": RATES[name]} for name, tensor in splats.named().items()]
    optimiser = torch.optim.Adam(groups, eps=1e-15)
    order: list[int] = []
    losses = []
    for step in range(settings.iterations):
        if not order:
            order = random.permutation(len(views)).tolist()
        view = views[order.pop()]
        for group, name in zip(optimiser.param_groups, RATES, strict=True):
            group["lr"] = RATES[name] * 0.1 ** (step / settings.iterations)
        loss = loss_of(draw(splats, view, settings.device), view, settings)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    return losses


def fused_points(splats: Splats, views: Sequence[SplatView], surface: Surface, settings: SplatParameters) -> Points:
    """Return the points of the surface that a distance field of all rendered depths has."""
    low, high = surface.vertices.min(axis=0) - 0.008, surface.vertices.max(axis=0) + 0.008
    field = DistanceField.empty(low, high, settings.cell)
    for view in views:
        with torch.no_grad():
            outputs = draw(splats, view, settings.device).cpu().numpy().astype(np.float64)
        cover = outputs[..., 1]
        depth = outputs[..., 2] / np.maximum(cover, 1e-6)
        good = view.shows & (cover > LEAST_COVER)
        target = view.target
        rows, columns = np.mgrid[: target.height, : target.width] + 0.5
        ray = np.stack([(columns - target.centre_x) / target.focal, (rows - target.centre_y) / target.focal], axis=-1)
        length = np.sqrt((ray**2).sum(axis=-1) + 1)
        normal = outputs[..., 3:6] / np.maximum(np.linalg.norm(outputs[..., 3:6], axis=-1, keepdims=True), 1e-9)
        cosine = -((normal[..., :2] * ray).sum(axis=-1) + normal[..., 2]) / length
        field.add(np.where(good & (cosine > LARGEST_SLOPE), depth, 0), target, view.T_camera_scene)
    positions, normals = field.surface()
    return Points(positions, normals, 0.0)


@dataclass(frozen=True)
class _Task:
    name: str
    found: DenseObject
    views: tuple[SplatView, ...]
    support: float
    settings: ReconstructParameters
    seed: int


def _splat(task: _Task) -> DenseObject:
    torch.set_num_threads(1)
    settings = task.settings.splat
    splats = initial_splats(task.found.points, settings.spacing, task.views, settings.device)
    train(splats, task.views, settings, item_generator(task.seed, "reconstruct", task.name, 0))
    points = fused_points(splats, task.views, task.found.surface, settings)
    points = replace(task.found.points, positions=points.positions, towards=points.towards)
    surface = poisson_surface(points, task.support, settings.cell, task.settings.surface, task.name)
    return DenseObject(points, surface, task.found.windows, task.found.maps)


def check_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises:
        UserError: torch or Warp cannot use it.
    """
    try:
        torch.empty(0, device=device)
        warp().get_device(device)
    except (RuntimeError, AssertionError, ValueError) as error:
        raise UserError(f"reconstruct.splat.device is {device}, which cannot be used here; set it to cpu.") from error


def splatted_objects(
    views: Sequence[View],
    dense: Mapping[str, DenseObject],
    priors: Mapping[str, NDArray[np.float32]],
    scene: Scene,
    settings: ReconstructParameters,
    seed: int,
    workers: Workers,
) -> dict[str, DenseObject]:
    """Return the objects of the plane sweep with the surfaces that splatting makes of them.

    Args:
        priors: per view name its undistorted normal map (h, w, 3), camera frame; may be empty.

    Raises:
        UserError: an object is too small in the photos, or its splats enclose nothing.
    """
    bodies, scale = Bodies([found.surface for found in dense.values()]), settings.splat.image_scale
    tasks = []
    for number, (name, found) in enumerate(dense.items()):
        windows = [(views[index], window) for index, window in found.windows.items()]
        shrunk = [shrunk_view(view, window, bodies, number, scale, priors.get(view.name)) for view, window in windows]
        shown = tuple(view for view in shrunk if view.shows.sum() >= LEAST_PIXELS)
        if len(shown) < LEAST_VIEWS:
            raise UserError(
                f"{name}: only {len(shown)} photos show enough of it for splatting; raise "
                "reconstruct.splat.image_scale, or take the photos from nearer."
            )
        tasks.append(_Task(name, found, shown, scene.support_plane, settings, seed))
    done = fan_out(_splat, tasks, workers, "splatting")
    return {task.name: found for task, found in zip(tasks, done, strict=True)}
