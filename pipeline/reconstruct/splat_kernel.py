"""Rasteriser of 2D Gaussian splats (Huang et al. 2024) and its gradient, in Warp: one source for CPU and CUDA.

One thread renders one pixel. A splat is a flat Gaussian with centre P, unit tangents and normal (u, v, n) and extents
(a, b), all in the camera frame. The ray z * d, d = ((x - cx) / f, (y - cy) / f, 1), meets its plane at the depth
z = (n . P) / (n . d); with X = z d its value there is G = exp(-(s^2 + t^2) / 2), s = u . (X - P) / a and
t = v . (X - P) / b.
Splats seen edge-on keep the width of a pixel (G at least exp(-|pixel - centre|^2), as published).

Front to back, opacity * G gives the weights w of the splats. A pixel's outputs are the sums

    0 brightness  sum w c      2 depth     sum w z          6 distortion  sum_i<j w_i w_j (m_i - m_j)^2
    1 cover       sum w        3-5 normal  sum w n          7             sum w m^2

with m = (z - near) * per_depth, depth brought to about 0 to 1, and n turned towards the camera.

The gradient uses dL/dw_i = q_i, the sum of the outputs' gradients times what they sum, and for opacity * G = alpha_i:
dL/dalpha_i = T_i q_i - (sum_j>i w_j q_j) / (1 - alpha_i), where T_i is the light that arrives at splat i.

This module must not postpone the evaluation of annotations: Warp reads them as types.
"""

import warp as wp

TILE = 16  # pixels
OUTPUTS = 8

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


@wp.struct
class Splats:
    """Splats in the camera frame, and which of them every tile must draw, near to far."""

    centre: wp.array(dtype=wp.vec3)
    tangent_u: wp.array(dtype=wp.vec3)
    tangent_v: wp.array(dtype=wp.vec3)
    normal: wp.array(dtype=wp.vec3)
    extent: wp.array(dtype=wp.vec2)
    opacity: wp.array(dtype=float)
    brightness: wp.array(dtype=float)
    tile_start: wp.array(dtype=int)  # (tiles + 1,)
    drawn: wp.array(dtype=int)


@wp.struct
class Pinhole:
    """The window of a camera that is rendered."""

    width: int
    height: int
    tiles_across: int
    focal: float
    centre_x: float  # principal point in pixels of the window
    centre_y: float
    near: float
    per_depth: float


@wp.struct
class Hit:
    """What a ray meets of one splat."""

    alpha: float
    value: float  # G
    depth: float
    s: float
    t: float
    slope: float  # n . d
    planar: int  # 1: the splat's own Gaussian; 0: the pixel-wide one
    side: float  # -1 when the normal points away from the camera


@wp.func
def meet(splats: Splats, k: int, ray: wp.vec3, camera: Pinhole, x: float, y: float):
    """Return what the ray through the pixel (x, y) meets of splat k."""
    hit = Hit()
    P = splats.centre[k]
    n = splats.normal[k]
    extent = splats.extent[k]
    slope = wp.dot(n, ray)
    hit.side = 1.0
    if wp.dot(n, P) > 0.0:
        hit.side = -1.0
    hit.slope = slope
    hit.value = 0.0
    hit.planar = 1
    hit.depth = P[2]
    if wp.abs(slope) > 1.0e-4:
        z = wp.dot(n, P) / slope
        if z > 0.5 * P[2] and z < 2.0 * P[2]:
            off = z * ray - P
            hit.s = wp.dot(splats.tangent_u[k], off) / extent[0]
            hit.t = wp.dot(splats.tangent_v[k], off) / extent[1]
            hit.value = wp.exp(-0.5 * (hit.s * hit.s + hit.t * hit.t))
            hit.depth = z
    px = x - (camera.focal * P[0] / P[2] + camera.centre_x)
    py = y - (camera.focal * P[1] / P[2] + camera.centre_y)
    wide = wp.exp(-(px * px + py * py))
    if wide > hit.value:
        hit.value = wide
        hit.planar = 0
        hit.depth = P[2]
    hit.alpha = wp.min(splats.opacity[k] * hit.value, 0.99)
    return hit


@wp.kernel
def render(splats: Splats, camera: Pinhole, outputs: wp.array2d(dtype=float)):
    """Write the outputs (pixels, OUTPUTS) of every pixel."""
    pixel = wp.tid()
    column = pixel % camera.width
    row = pixel // camera.width
    x = float(column) + 0.5
    y = float(row) + 0.5
    ray = wp.vec3((x - camera.centre_x) / camera.focal, (y - camera.centre_y) / camera.focal, 1.0)
    tile = (row // TILE) * camera.tiles_across + column // TILE
    arriving = float(1.0)
    brightness = float(0.0)
    cover = float(0.0)
    depth = float(0.0)
    normal = wp.vec3(0.0, 0.0, 0.0)
    distortion = float(0.0)
    first = float(0.0)
    second = float(0.0)
    entry = int(splats.tile_start[tile])
    end = splats.tile_start[tile + 1]
    while entry < end and arriving > 1.0e-4:
        k = splats.drawn[entry]
        entry += 1
        hit = meet(splats, k, ray, camera, x, y)
        if hit.alpha > 1.0 / 255.0:
            w = arriving * hit.alpha
            m = (hit.depth - camera.near) * camera.per_depth
            distortion += w * (m * m * cover + second - 2.0 * m * first)
            brightness += w * splats.brightness[k]
            cover += w
            depth += w * hit.depth
            normal += w * hit.side * splats.normal[k]
            first += w * m
            second += w * m * m
            arriving *= 1.0 - hit.alpha
    outputs[pixel, 0] = brightness
    outputs[pixel, 1] = cover
    outputs[pixel, 2] = depth
    outputs[pixel, 3] = normal[0]
    outputs[pixel, 4] = normal[1]
    outputs[pixel, 5] = normal[2]
    outputs[pixel, 6] = distortion
    outputs[pixel, 7] = second


@wp.kernel
def render_gradient(
    splats: Splats,
    camera: Pinhole,
    outputs: wp.array2d(dtype=float),
    gradient: wp.array2d(dtype=float),
    d_centre: wp.array(dtype=wp.vec3),
    d_tangent_u: wp.array(dtype=wp.vec3),
    d_tangent_v: wp.array(dtype=wp.vec3),
    d_normal: wp.array(dtype=wp.vec3),
    d_extent: wp.array(dtype=wp.vec2),
    d_opacity: wp.array(dtype=float),
    d_brightness: wp.array(dtype=float),
):
    """Add the derivatives of a loss by all splats; ``gradient`` (pixels, OUTPUTS) is its derivative by the outputs.

    The last output (sum w m^2) has no gradient of its own.
    """
    pixel = wp.tid()
    column = pixel % camera.width
    row = pixel // camera.width
    x = float(column) + 0.5
    y = float(row) + 0.5
    ray = wp.vec3((x - camera.centre_x) / camera.focal, (y - camera.centre_y) / camera.focal, 1.0)
    tile = (row // TILE) * camera.tiles_across + column // TILE
    g_brightness = gradient[pixel, 0]
    g_cover = gradient[pixel, 1]
    g_depth = gradient[pixel, 2]
    g_normal = wp.vec3(gradient[pixel, 3], gradient[pixel, 4], gradient[pixel, 5])
    g_distortion = gradient[pixel, 6]
    cover = outputs[pixel, 1]
    total_normal = wp.vec3(outputs[pixel, 3], outputs[pixel, 4], outputs[pixel, 5])
    first = (outputs[pixel, 2] - camera.near * cover) * camera.per_depth
    second = outputs[pixel, 7]
    # Sum of w q over the splats that are still to come.
    rest = float(
        g_brightness * outputs[pixel, 0]
        + g_cover * cover
        + g_depth * outputs[pixel, 2]
        + wp.dot(g_normal, total_normal)
        + 2.0 * g_distortion * outputs[pixel, 6]
    )
    arriving = float(1.0)
    entry = int(splats.tile_start[tile])
    end = splats.tile_start[tile + 1]
    while entry < end and arriving > 1.0e-4:
        k = splats.drawn[entry]
        entry += 1
        hit = meet(splats, k, ray, camera, x, y)
        if hit.alpha > 1.0 / 255.0:
            w = arriving * hit.alpha
            m = (hit.depth - camera.near) * camera.per_depth
            q = (
                g_brightness * splats.brightness[k]
                + g_cover
                + g_depth * hit.depth
                + hit.side * wp.dot(g_normal, splats.normal[k])
                + g_distortion * (m * m * cover + second - 2.0 * m * first)
            )
            rest -= w * q
            d_alpha = arriving * q - rest / (1.0 - hit.alpha)
            d_depth = w * (g_depth + 2.0 * g_distortion * (m * cover - first) * camera.per_depth)
            d_n = w * hit.side * g_normal
            d_P = wp.vec3(0.0, 0.0, 0.0)
            d_value = float(0.0)
            if splats.opacity[k] * hit.value < 0.99:
                d_value = d_alpha * splats.opacity[k]
                wp.atomic_add(d_opacity, k, d_alpha * hit.value)
            P = splats.centre[k]
            if hit.planar == 1:
                extent = splats.extent[k]
                n = splats.normal[k]
                off = hit.depth * ray - P
                d_s = -hit.s * hit.value * d_value
                d_t = -hit.t * hit.value * d_value
                d_off = splats.tangent_u[k] * (d_s / extent[0]) + splats.tangent_v[k] * (d_t / extent[1])
                wp.atomic_add(d_tangent_u, k, off * (d_s / extent[0]))
                wp.atomic_add(d_tangent_v, k, off * (d_t / extent[1]))
                wp.atomic_add(d_extent, k, wp.vec2(-hit.s * d_s / extent[0], -hit.t * d_t / extent[1]))
                along = (d_depth + wp.dot(ray, d_off)) / hit.slope
                d_P = n * along - d_off
                d_n -= off * along
            else:
                px = x - (camera.focal * P[0] / P[2] + camera.centre_x)
                py = y - (camera.focal * P[1] / P[2] + camera.centre_y)
                across = 2.0 * hit.value * d_value * camera.focal / P[2]
                d_P = wp.vec3(across * px, across * py, d_depth - across * (px * P[0] + py * P[1]) / P[2])
            wp.atomic_add(d_centre, k, d_P)
            wp.atomic_add(d_normal, k, d_n)
            wp.atomic_add(d_brightness, k, w * g_brightness)
            arriving *= 1.0 - hit.alpha
