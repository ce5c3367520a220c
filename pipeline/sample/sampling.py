"""From noise to grasps of one pair."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.model.checkpoint import Checkpoint
from pipeline.model.clouds import Clouds, prepare_cloud, stack
from pipeline.model.diffusion import draw
from pipeline.model.network import GraspModel, cloud_tensors
from pipeline.model.representation import GraspBatch, from_vectors, joint_violation

CLOUDS = 8  # draws of each object's points, shared among the samples: no sample set hangs on one unlucky draw


def sample_grasps(
    checkpoint: Checkpoint,
    model: GraspModel,
    hand: Hand,
    points: tuple[NDArray[np.float64], NDArray[np.float64]],
    count: int,
    sampler: str,
    steps: int,
    seed: int,
) -> tuple[GraspBatch, NDArray[np.float64]]:
    """Return ``count`` grasps of a pair and how far their joints lay beyond the limits, (count, J) rad.

    Args:
        points: surface points (m, 3) of object 0 and object 1, object frame.
    """
    clouds = sampled_clouds(checkpoint, points, min(CLOUDS, count), seed)
    return grasps_from_clouds(checkpoint, model, hand, clouds, count, sampler, steps, seed)


def sampled_clouds(
    checkpoint: Checkpoint, points: tuple[NDArray[np.float64], NDArray[np.float64]], draws: int, seed: int
) -> Clouds:
    """Return ``draws`` clouds of object 0, then as many of object 1."""
    rng = np.random.default_rng(seed)
    return stack([prepare_cloud(own, checkpoint.encoder, rng, even=True) for own in points for _ in range(draws)])


def grasps_from_clouds(
    checkpoint: Checkpoint,
    model: GraspModel,
    hand: Hand,
    clouds: Clouds,
    count: int,
    sampler: str,
    steps: int,
    seed: int,
) -> tuple[GraspBatch, NDArray[np.float64]]:
    """Return what :func:`sample_grasps` does, from clouds of :func:`sampled_clouds`."""
    draws = len(clouds) // 2
    device = next(model.parameters()).device
    pairs = torch.arange(draws, device=device)[:, None] + torch.tensor([0, draws], device=device)
    with torch.no_grad():
        context = model.context(cloud_tensors(clouds, device), pairs)
        pair = torch.arange(count, device=device) % draws
        generator = torch.Generator(device).manual_seed(seed)
        normal = draw(
            checkpoint.diffusion,
            lambda x, time: model(x, time, context, pair),
            (count, len(checkpoint.normalisation.mean)),
            sampler,
            steps,
            generator,
        )
    vectors = checkpoint.normalisation.undo(normal.cpu().numpy().astype(np.float64))
    return from_vectors(hand, vectors), joint_violation(vectors, hand)
