"""Splats that are trained: on pictures of known splats, and with normal maps."""

import numpy as np
import pytest

from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SplatParameters

torch = pytest.importorskip("torch")

SIZE = 48  # pixels
SIDE, SPACING = 15, 0.002  # splats along an edge, m


@pytest.fixture(scope="module")
def plane():
    """A textured square of splats that lies flat, and views of it from above."""
    from pipeline.capture.layout import TARGET_HEIGHT, camera_poses
    from pipeline.reconstruct.rasterise import Target
    from pipeline.reconstruct.splatting import Splats, SplatView, draw

    random = np.random.default_rng(0)
    axis = (np.arange(SIDE) - (SIDE - 1) / 2) * SPACING
    centre = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    count = len(centre)
    true = Splats(
        torch.tensor(np.column_stack([centre, np.full(count, TARGET_HEIGHT)]), dtype=torch.float32),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        torch.full((count, 2), float(np.log(0.6 * SPACING))),
        torch.full((count,), 2.0),
        torch.tensor(random.uniform(0.2, 0.8, count), dtype=torch.float32),
    )
    camera = Target(SIZE, SIZE, 450.0, SIZE / 2, SIZE / 2, 0.3, 0.5)
    views = []
    for pose in camera_poses(6, 0.4, random):
        blank = SplatView(camera, pose, np.zeros((SIZE, SIZE), np.float32), np.ones((SIZE, SIZE), bool), None)
        outputs = draw(true, blank, "cpu").numpy()
        shows = outputs[..., 1] > 0.8
        image = np.ascontiguousarray(outputs[..., 0] / np.maximum(outputs[..., 1], 1e-3))
        views.append(SplatView(camera, pose, image, shows, None))
    return true, views


def test_displaced_splats_find_back(plane):
    from pipeline.reconstruct.splatting import Splats, train

    true, views = plane
    assert all(view.shows.sum() > 100 for view in views)
    start = {name: tensor.clone() for name, tensor in true.named().items()}
    start["centre"][:, 2] += 0.0006
    splats = Splats(**{name: tensor.requires_grad_() for name, tensor in start.items()})
    losses = train(splats, views, SplatParameters(iterations=90), np.random.default_rng(0))
    assert np.mean(losses[-6:]) < 0.7 * np.mean(losses[:6])
    inner = (true.centre[:, :2].abs() < 0.3 * SIDE * SPACING).all(dim=1)
    off = (splats.centre.detach() - true.centre)[inner, 2]
    assert float(off.abs().mean()) < 0.0003


def test_normal_maps_enter_the_loss(plane):
    from dataclasses import replace

    from pipeline.reconstruct.splatting import draw, loss_of

    true, views = plane
    outputs = draw(true, views[0], "cpu")
    tilted = np.zeros((SIZE, SIZE, 3), np.float32)
    tilted[:, :30] = [0.6, 0.0, -0.8]  # unknown in the rest
    with_prior = replace(views[0], prior=tilted)
    settings = SplatParameters(weight_prior=0.2)
    extra = loss_of(outputs, with_prior, settings) - loss_of(outputs, views[0], settings)
    known = views[0].shows & (np.arange(SIZE) < 30)
    drawn = outputs.numpy()
    expected = 0.2 * (drawn[..., 1] - (drawn[..., 3:6] * tilted).sum(axis=-1))[known].mean()
    assert float(extra) == pytest.approx(float(expected), rel=1e-4)
    unknown = replace(views[0], prior=np.zeros((SIZE, SIZE, 3), np.float32))
    assert float(loss_of(outputs, unknown, settings)) == float(loss_of(outputs, views[0], settings))


def test_a_device_that_is_not_there_is_one_sentence():
    from pipeline.reconstruct.splatting import check_device

    check_device("cpu")
    with pytest.raises(UserError, match="splat.device is cuda:77"):
        check_device("cuda:77")
