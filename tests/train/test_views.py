"""Training on one camera's views."""

import numpy as np

from pipeline.hand.model import load_hand
from pipeline.records.parameters.train import TrainDataParameters
from pipeline.records.poses import transform_points
from pipeline.train.data import gather_examples
from pipeline.train.training import train


def test_views_lie_on_their_objects_and_a_model_of_them_says_so(tables, objects, settings, tmp_path):
    data = TrainDataParameters(held_out=0.1, view="single")
    examples = gather_examples(tables, objects, data, settings.encoder, 1)
    draws = settings.encoder.clouds
    for index, frame in enumerate(examples.frames):
        item = objects[examples.objects[index // draws]]
        points = transform_points(frame, examples.clouds.points[index].astype(np.float64))
        low, high = item.vertices.min(axis=0), item.vertices.max(axis=0)
        assert (points > low - 0.006).all() and (points < high + 0.006).all()
        np.testing.assert_allclose(frame[2, :3], [0, 0, 1], atol=1e-12)  # upright
    single = settings.model_copy(update={"data": data})
    checkpoint, history = train(examples, single, 1, tmp_path / "state.pt", load_hand("allegro"))
    assert checkpoint.view == "single" and np.isfinite(history[-1]["training_loss"])
