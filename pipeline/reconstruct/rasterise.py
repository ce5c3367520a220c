"""Splats to pictures, differentiable for torch: tiles are filled here, pixels are computed by the Warp kernel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from pipeline.compute.warp import warp
from pipeline.reconstruct import splat_kernel as kernel

REACH = 3.4  # standard deviations: beyond, even an opaque splat covers less than 1/255


@dataclass(frozen=True)
class Target:
    """The window of a pinhole camera."""

    width: int
    height: int
    focal: float  # pixels
    centre_x: float  # principal point in pixels of the window
    centre_y: float
    near: float  # m; depths about near .. far are brought to 0 .. 1 for the distortion term
    far: float


def _tiles(centre: np.ndarray, extent: np.ndarray, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Return per tile where its list starts (tiles + 1,), and the lists of splats, near to far."""
    across, down = -(-target.width // kernel.TILE), -(-target.height // kernel.TILE)
    depth = centre[:, 2]
    safe = np.maximum(depth, 1e-6)
    x = target.focal * centre[:, 0] / safe + target.centre_x
    y = target.focal * centre[:, 1] / safe + target.centre_y
    radius = np.maximum(REACH * target.focal * extent.max(axis=1) / safe, 2.5) + 1
    low = np.floor(np.stack([x - radius, y - radius]) / kernel.TILE)
    high = np.floor(np.stack([x + radius, y + radius]) / kernel.TILE)
    limits = np.array([[across - 1], [down - 1]])
    shown = (depth > 1e-3) & (high >= 0).all(axis=0) & (low <= limits).all(axis=0)
    order = np.flatnonzero(shown)[np.argsort(depth[shown], kind="stable")]
    left, top = np.clip(low, 0, limits).astype(np.int64)[:, order]
    right, bottom = np.clip(high, 0, limits).astype(np.int64)[:, order]
    columns, rows = right - left + 1, bottom - top + 1
    count = columns * rows
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    which = np.repeat(np.arange(len(order)), count)
    tile = (top[which] + number // columns[which]) * across + left[which] + number % columns[which]
    arranged = np.argsort(tile, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=across * down))])
    return start.astype(np.int32), order[which[arranged]].astype(np.int32)


def _structs(tensors: tuple[torch.Tensor, ...], target: Target, device: str) -> tuple[Any, Any]:
    wp = warp()
    centre, tangent_u, tangent_v, normal, extent, opacity, brightness = (t.detach().contiguous() for t in tensors)
    start, drawn = _tiles(centre.cpu().numpy(), extent.cpu().numpy(), target)
    splats = kernel.Splats()
    splats.centre = wp.from_torch(centre, dtype=wp.vec3)
    splats.tangent_u = wp.from_torch(tangent_u, dtype=wp.vec3)
    splats.tangent_v = wp.from_torch(tangent_v, dtype=wp.vec3)
    splats.normal = wp.from_torch(normal, dtype=wp.vec3)
    splats.extent = wp.from_torch(extent, dtype=wp.vec2)
    splats.opacity = wp.from_torch(opacity)
    splats.brightness = wp.from_torch(brightness)
    splats.tile_start = wp.array(start, dtype=int, device=device)
    splats.drawn = wp.array(drawn if len(drawn) else np.zeros(1, np.int32), dtype=int, device=device)
    camera = kernel.Pinhole()
    camera.width, camera.height = target.width, target.height
    camera.tiles_across = -(-target.width // kernel.TILE)
    camera.focal, camera.centre_x, camera.centre_y = target.focal, target.centre_x, target.centre_y
    camera.near, camera.per_depth = target.near, 1 / (target.far - target.near)
    return splats, camera


class _Rasterise(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, target: Target, device: str, *tensors: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        wp = warp()
        splats, camera = _structs(tensors, target, device)
        outputs = torch.zeros((target.width * target.height, kernel.OUTPUTS), device=tensors[0].device)
        wp.launch(kernel.render, dim=len(outputs), inputs=[splats, camera, wp.from_torch(outputs)], device=device)
        ctx.save_for_backward(outputs, *tensors)
        ctx.target, ctx.device, ctx.structs = target, device, (splats, camera)
        return outputs

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> Any:
        wp = warp()
        outputs, *tensors = ctx.saved_tensors
        splats, camera = ctx.structs
        found = [torch.zeros_like(tensor) for tensor in tensors]
        types = [wp.vec3, wp.vec3, wp.vec3, wp.vec3, wp.vec2, wp.float32, wp.float32]
        wp.launch(
            kernel.render_gradient,
            dim=len(outputs),
            inputs=[splats, camera, wp.from_torch(outputs.detach()), wp.from_torch(gradients[0].detach().contiguous())],
            outputs=[wp.from_torch(tensor, dtype=kind) for tensor, kind in zip(found, types, strict=True)],
            device=ctx.device,
        )
        return None, None, *found


def rasterise(
    target: Target,
    device: str,
    centre: torch.Tensor,
    tangent_u: torch.Tensor,
    tangent_v: torch.Tensor,
    normal: torch.Tensor,
    extent: torch.Tensor,
    opacity: torch.Tensor,
    brightness: torch.Tensor,
) -> torch.Tensor:
    """Return the outputs (height, width, OUTPUTS) of ``splat_kernel``, differentiable but in the last.

    Args:
        device: Warp's name of the device on which all tensors lie.
        centre: (n, 3) camera frame, m; tangents and normal (n, 3) unit; extent (n, 2) m; opacity, brightness (n,).
    """
    flat = _Rasterise.apply(target, device, centre, tangent_u, tangent_v, normal, extent, opacity, brightness)
    return flat.reshape(target.height, target.width, kernel.OUTPUTS)
