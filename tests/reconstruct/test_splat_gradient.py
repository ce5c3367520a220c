"""The hand-derived gradient of the splat rasteriser against finite differences and against plain torch."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

TARGET_SIZE = 24
NAMES = ["centre", "tangent_u", "tangent_v", "normal", "extent", "opacity", "brightness"]


def random_splats(count: int = 10, seed: int = 0):
    random = np.random.default_rng(seed)
    centre = np.column_stack([random.uniform(-0.02, 0.02, (count, 2)), random.uniform(0.45, 0.55, count)])
    rotation = np.linalg.qr(random.standard_normal((count, 3, 3)))[0]
    extent = random.uniform(0.004, 0.012, (count, 2))
    opacity, brightness = random.uniform(0.3, 0.9, count), random.uniform(0, 1, count)
    arrays = [centre, rotation[:, :, 0], rotation[:, :, 1], rotation[:, :, 2], extent, opacity, brightness]
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


def target():
    from pipeline.reconstruct.rasterise import Target

    return Target(TARGET_SIZE, TARGET_SIZE, 200.0, 12.0, 12.0, 0.4, 0.6)


def plain_render(camera, centre, u, v, n, extent, opacity, brightness):
    """The same picture by plain torch in double precision: every splat on every pixel."""
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    x, y = columns.reshape(-1, 1) + 0.5, rows.reshape(-1, 1) + 0.5
    order = torch.argsort(centre[:, 2])
    centre, u, v, n, extent, opacity, brightness = (t[order] for t in (centre, u, v, n, extent, opacity, brightness))
    ray = torch.stack(
        [(x - camera.centre_x) / camera.focal, (y - camera.centre_y) / camera.focal, torch.ones_like(x)], -1
    ).double()
    z = (n * centre).sum(-1) / (ray * n).sum(-1)
    off = z[..., None] * ray - centre
    s, t = (u * off).sum(-1) / extent[:, 0], (v * off).sum(-1) / extent[:, 1]
    planar = torch.exp(-0.5 * (s * s + t * t))
    planar = torch.where((z > 0.5 * centre[:, 2]) & (z < 2 * centre[:, 2]), planar, torch.zeros_like(planar))
    px = x - (camera.focal * centre[:, 0] / centre[:, 2] + camera.centre_x)
    py = y - (camera.focal * centre[:, 1] / centre[:, 2] + camera.centre_y)
    wide = torch.exp(-(px * px + py * py))
    depth = torch.where(wide > planar, centre[:, 2].expand_as(z), z)
    alpha = opacity * torch.maximum(planar, wide)
    alpha = torch.where(alpha > 1 / 255, alpha, torch.zeros_like(alpha))
    arriving = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1 - alpha[:, :-1]], 1), 1)
    w = arriving * alpha
    side = torch.where((n * centre).sum(-1) > 0, -1.0, 1.0)[:, None]
    m = (depth - camera.near) / (camera.far - camera.near)
    distortion = 0.5 * (w[:, :, None] * w[:, None, :] * (m[:, :, None] - m[:, None, :]) ** 2).sum((1, 2))
    normal = (w[..., None] * (side * n)).sum(1)
    columns = [(w * brightness).sum(1), w.sum(1), (w * depth).sum(1), *normal.T, distortion]
    return torch.stack(columns, -1)


def test_pictures_and_gradients_equal_plain_torch():
    from pipeline.reconstruct.rasterise import rasterise

    camera, splats = target(), random_splats()
    weights = torch.tensor(np.random.default_rng(1).standard_normal((TARGET_SIZE**2, 7)))
    ours = [tensor.clone().requires_grad_() for tensor in splats]
    picture = rasterise(camera, "cpu", *ours).reshape(-1, 8)[:, :7]
    theirs = [tensor.double().requires_grad_() for tensor in splats]
    expected = plain_render(camera, *theirs)
    assert torch.allclose(picture.double(), expected, atol=2e-5)
    (picture.double() * weights).sum().backward()
    (expected * weights).sum().backward()
    for name, one, other in zip(NAMES, ours, theirs, strict=True):
        a, b = one.grad.double().flatten(), other.grad.flatten()
        assert torch.linalg.norm(a - b) < 2e-3 * torch.linalg.norm(b), name


def test_gradient_equals_finite_differences():
    from pipeline.reconstruct.rasterise import rasterise

    camera, splats = target(), random_splats(count=4, seed=3)
    # Large splats that face the camera: where one is cut off (1/255), or another lies in front, a step would be felt.
    random = np.random.default_rng(4)
    angles = torch.tensor(random.uniform(-0.5, 0.5, (4, 3)), dtype=torch.float32)
    rotation = torch.linalg.matrix_exp(torch.cross(torch.eye(3).expand(4, 3, 3), angles[:, None].expand(4, 3, 3), 2))
    splats[1], splats[2], splats[3] = (rotation[:, :, axis].contiguous() for axis in range(3))
    splats[4] = torch.tensor(random.uniform(0.03, 0.05, (4, 2)), dtype=torch.float32)
    weights = torch.tensor(np.random.default_rng(2).standard_normal((TARGET_SIZE, TARGET_SIZE, 7)))

    def loss(tensors) -> float:
        return float((rasterise(camera, "cpu", *tensors)[..., :7].double() * weights).sum())

    ours = [tensor.clone().requires_grad_() for tensor in splats]
    (rasterise(camera, "cpu", *ours)[..., :7].double() * weights).sum().backward()
    steps = [2e-5, 2e-3, 2e-3, 2e-3, 2e-5, 2e-3, 2e-3]
    for name, tensor, step, own in zip(NAMES, splats, steps, ours, strict=True):
        numeric = torch.zeros_like(tensor)
        for index in np.ndindex(*tensor.shape):
            before = tensor[index].item()
            tensor[index] = before + step
            above = loss(splats)
            tensor[index] = before - step
            below = loss(splats)
            tensor[index] = before
            numeric[index] = (above - below) / (2 * step)
        correlation = torch.corrcoef(torch.stack([numeric.flatten(), own.grad.flatten()]))[0, 1]
        assert correlation > 0.99, (name, correlation)
