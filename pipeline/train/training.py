"""The training loop: examples in, weights and losses out. Everything else of the room is called from here.

In one step: take a batch of grasps, take one of the stored clouds of every object, add noise of a random strength,
predict, compare. Where a number differs from the paper's, the paper's stands beside it in
``pipeline.records.parameters.train``. What the released code does not do and is done here, because with it the model
learned little (figures: docs/departures.md): normalisation, a schedule that reaches noise, averaged weights, a clipped
gradient, held-out examples.

All randomness of a step comes from a generator seeded by the step. So a run that was killed and resumed draws the same
numbers as one that was not, and ends in the same weights, to the byte, for the same number of threads.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.compute.progress import watched
from pipeline.hand.model import Hand
from pipeline.model.checkpoint import Checkpoint
from pipeline.model.diffusion import signal_and_noise, target
from pipeline.model.network import CloudTensors, GraspModel, cloud_tensors
from pipeline.model.representation import GraspBatch, fit_normalisation, in_frames, to_vectors, turn_objects
from pipeline.records.parameters.train import OptimizationParameters, TrainingParameters
from pipeline.records.writing import whole_file
from pipeline.stages.seeds import item_seed
from pipeline.train.data import Examples

FEW = 4  # draws per object that the network is calibrated with
TURNS = 16  # of every object, for statistics of turned grasps
VALIDATION_DRAWS = 8  # noises per held-out example; always the same ones, so that points of the curve compare


@dataclass(frozen=True)
class Batch:
    """Everything random of one step, as tensors."""

    clean: Tensor  # (B, D) normalised
    pair: Tensor  # (B,) index into pairs
    time: Tensor  # (B,) 0..1
    eps: Tensor  # (B, D)
    clouds: CloudTensors  # one per object


class Source:
    """Makes batches; the batch of a step depends on the seed and the step alone."""

    def __init__(self, examples: Examples, settings: TrainingParameters, seed: int, split: str, hand: Hand) -> None:
        self.examples, self.settings, self.seed, self.hand = examples, settings, seed, hand
        self.rows = np.flatnonzero(examples.split == split)
        training = examples.grasps[examples.split == "training"]
        # Statistics of what is trained on; with turned frames, of turned grasps.
        if examples.frames is not None:
            objects = examples.pair_objects()[examples.pair[examples.split == "training"]]
            draws = settings.encoder.clouds
            seen = [in_frames(training, examples.frames[objects * draws + turn % draws]) for turn in range(TURNS)]
            training = GraspBatch(np.concatenate([g.T_hand_object for g in seen]), np.tile(training.q, (TURNS, 1)))
        if settings.data.yaw_augmentation:
            turns = np.linspace(0, 2 * np.pi, TURNS, endpoint=False)
            turned = [turn_objects(training, np.full(training.T_hand_object.shape[:2], turn)) for turn in turns]
            training = GraspBatch(np.concatenate([g.T_hand_object for g in turned]), np.tile(training.q, (TURNS, 1)))
        self.normalisation = fit_normalisation(to_vectors(self.hand, training), settings.data.normalise)
        self.clouds = cloud_tensors(examples.clouds)
        self.pairs = torch.as_tensor(examples.pair_objects())

    def batch(self, step: int, rows: NDArray[np.int64] | None = None) -> Batch:
        """Return the batch of a step: random rows of the split, or the given ones."""
        seed = item_seed(self.seed, "train", "step", step)
        rng, generator = np.random.default_rng(seed), torch.Generator().manual_seed(seed)
        size = self.settings.optimization.batch
        rows = self.rows[rng.integers(len(self.rows), size=size)] if rows is None else rows
        objects, draws = len(self.examples.objects), self.settings.encoder.clouds
        chosen = np.arange(objects) * draws + rng.integers(draws, size=objects)
        clouds = self.clouds.chosen(torch.as_tensor(chosen))
        grasps, pair = self.examples.grasps[rows], self.examples.pair[rows]
        if self.examples.frames is not None:
            grasps = in_frames(grasps, self.examples.frames[chosen[self.examples.pair_objects()[pair]]])
        if self.settings.data.yaw_augmentation:
            angles = rng.uniform(0, 2 * np.pi, objects)  # one per object, so that it is still encoded once
            grasps = turn_objects(grasps, angles[self.examples.pair_objects()[pair]])
            clouds = _turn_clouds(clouds, angles)
        noise = torch.randn(clouds.points.shape, generator=generator) * self.settings.data.cloud_noise
        clouds = CloudTensors(clouds.points + noise, clouds.neighbours)
        vectors = self.normalisation.apply(to_vectors(self.hand, grasps))
        return Batch(
            clean=torch.as_tensor(vectors, dtype=torch.float32),
            pair=torch.as_tensor(pair),
            # Evenly spread times, each random within its share: less noise in the loss than independent ones.
            time=(torch.arange(len(rows)) + torch.rand(len(rows), generator=generator)) / len(rows),
            eps=torch.randn(vectors.shape, generator=generator),
            clouds=clouds,
        )

    def first_clouds(self, device: str) -> CloudTensors:
        """Return some draws of every object's cloud."""
        draws = self.settings.encoder.clouds
        index = [item * draws + draw for item in range(len(self.examples.objects)) for draw in range(min(draws, FEW))]
        return self.clouds.chosen(torch.tensor(index)).to(device)

    def validation(self) -> list[Batch]:
        """Return fixed batches that hold every row of the split the same number of times, with times shuffled."""
        if not len(self.rows):
            return []
        rows = np.random.default_rng(0).permutation(np.tile(self.rows, VALIDATION_DRAWS))
        parts = np.array_split(rows, -(-len(rows) // self.settings.optimization.batch))
        return [self.batch(-1 - index, part) for index, part in enumerate(parts)]


def _turn_clouds(clouds: CloudTensors, angles: NDArray[np.float64]) -> CloudTensors:
    """Turn each cloud (one per object) about z; neighbourhoods stay what they are."""
    cosine, sine = (torch.as_tensor(f(angles), dtype=torch.float32)[:, None] for f in (np.cos, np.sin))
    x, y, z = clouds.points.unbind(-1)
    return CloudTensors(torch.stack([cosine * x - sine * y, sine * x + cosine * y, z], dim=-1), clouds.neighbours)


def loss_of(model: GraspModel, batch: Batch, pairs: Tensor, settings: TrainingParameters) -> Tensor:
    """Return the mean squared error of the prediction, over batch and dimensions."""
    device = pairs.device
    clouds = batch.clouds.to(device)
    clean, eps, time, pair = (value.to(device) for value in (batch.clean, batch.eps, batch.time, batch.pair))
    signal, noise = signal_and_noise(settings.diffusion, time)
    noisy = signal[:, None] * clean + noise[:, None] * eps
    prediction = model(noisy, time, model.context(clouds, pairs), pair)
    return torch.nn.functional.mse_loss(prediction, target(settings.diffusion, clean, eps))


def learning_rate(step: int, settings: OptimizationParameters) -> float:
    """Return the rate of a step: half a cosine from the first to the last rate, after a short rise."""
    rise = min(1.0, (step + 1) / min(100, settings.steps))
    share = step / settings.steps
    high, low = settings.learning_rate, settings.last_learning_rate
    return rise * (low + (high - low) * 0.5 * (1 + math.cos(math.pi * share)))


def train(
    examples: Examples, settings: TrainingParameters, seed: int, state_file: Path, hand: Hand, code: str = ""
) -> tuple[Checkpoint, list[dict[str, float]]]:
    """Train a model and return it with its curve: step, epoch, learning rate and losses.

    Args:
        state_file: where an unfinished run is kept, to be resumed; removed by the caller once the model is written.
        code: digest of the code that trains and of the hand; a run of another is not resumed.
    """
    with _deterministic(settings.optimization):
        optimization = settings.optimization
        source = Source(examples, settings, seed, "training", hand)
        validation = {
            split: Source(examples, settings, seed, split, hand).validation() for split in ("held_out", "held_out_pair")
        }
        torch.manual_seed(item_seed(seed, "train", "weights"))
        dimensions = len(source.normalisation.mean)
        model = GraspModel(settings.encoder, settings.denoiser, dimensions).to(optimization.device)
        model.calibrate(source.first_clouds(optimization.device))
        average = copy.deepcopy(model).eval().requires_grad_(False)
        optimizer = torch.optim.AdamW(model.parameters(), weight_decay=optimization.weight_decay)
        pairs = source.pairs.to(optimization.device)

        identity = training_identity(examples, settings, seed, code)
        begin, history = _resume(state_file, identity, model, average, optimizer)
        losses: list[float] = []
        for step in watched(range(begin, optimization.steps), optimization.steps - begin, "training"):
            loss = loss_of(model, source.batch(step), pairs, settings)
            _descend(model, average, optimizer, loss, step, optimization)
            losses.append(loss.item())
            if (step + 1) % optimization.record_every == 0 or step + 1 == optimization.steps:
                point = {
                    "step": step + 1,
                    "epoch": (step + 1) * optimization.batch / len(source.rows),
                    "learning_rate": learning_rate(step, optimization),
                    "training_loss": float(np.mean(losses)),
                }
                for split, batches in validation.items():
                    if batches:
                        point[f"{split}_loss"] = _mean_loss(average, batches, pairs, settings)
                history.append(point)
                losses = []
                _keep(state_file, identity, step + 1, history, model, average, optimizer)
    trained = tuple(examples.pairs[index] for index in sorted(set(examples.pair[source.rows].tolist())))
    weights = {name: value.cpu() for name, value in average.state_dict().items()}
    checkpoint = Checkpoint(
        hand=hand.name,
        encoder=settings.encoder,
        denoiser=settings.denoiser,
        diffusion=settings.diffusion,
        normalisation=source.normalisation,
        pairs=trained,
        held_out=examples.held_out,
        weights=weights,
        view=settings.data.view,
    )
    return checkpoint, history


def _descend(
    model: GraspModel,
    average: GraspModel,
    optimizer: torch.optim.Optimizer,
    loss: Tensor,
    step: int,
    optimization: OptimizationParameters,
) -> None:
    """Take one step down the loss, and let the average of the weights follow."""
    for group in optimizer.param_groups:
        group["lr"] = learning_rate(step, optimization)
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    if optimization.gradient_clip is not None:
        torch.nn.utils.clip_grad_norm_(model.parameters(), optimization.gradient_clip)
    optimizer.step()
    # Early on the average follows quickly, or it would remember the random start.
    decay = min(optimization.ema_decay, (step + 1) / (step + 10))
    for slow, fast in zip(average.parameters(), model.parameters(), strict=True):
        slow.lerp_(fast.detach(), 1 - decay)


@torch.no_grad()
def _mean_loss(model: GraspModel, batches: list[Batch], pairs: Tensor, settings: TrainingParameters) -> float:
    weights = [len(batch.pair) for batch in batches]
    return float(np.average([loss_of(model, batch, pairs, settings).item() for batch in batches], weights=weights))


@contextmanager
def _deterministic(settings: OptimizationParameters) -> Iterator[None]:
    """Fix the number of threads and refuse operations whose result depends on their timing."""
    threads = torch.get_num_threads()
    torch.set_num_threads(settings.threads)
    torch.use_deterministic_algorithms(True, warn_only=settings.device == "cuda")
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(False)
        torch.set_num_threads(threads)


def training_identity(examples: Examples, settings: TrainingParameters, seed: int, code: str) -> str:
    """Return a digest of all that the model depends on: a state of another run must not be resumed."""
    # What is not learned from is not among the examples either.
    names = {"data": {"held_out_objects", "held_out_sources", "held_out_share"}}
    values = (seed, examples.pairs, examples.split.tolist(), sorted(examples.held_out.items()), torch.__version__, code)
    digest = hashlib.sha256(f"{settings.model_dump_json(exclude=names)} {values}".encode())
    for array in (examples.grasps.T_hand_object, examples.grasps.q, examples.pair, examples.clouds.points):
        digest.update(np.ascontiguousarray(array).tobytes())
    if examples.frames is not None:
        digest.update(examples.frames.tobytes())
    return digest.hexdigest()


def _keep(
    state_file: Path,
    identity: str,
    step: int,
    history: list[dict[str, float]],
    model: GraspModel,
    average: GraspModel,
    optimizer: torch.optim.Optimizer,
) -> None:
    state = {"identity": identity, "step": step, "history": history}
    with whole_file(state_file) as temporary:
        torch.save(
            state
            | {
                "model": model.state_dict(),
                "average": average.state_dict(),
                "optimizer": optimizer.state_dict(),
            },
            temporary,
        )


def _resume(
    state_file: Path, identity: str, model: GraspModel, average: GraspModel, optimizer: torch.optim.Optimizer
) -> tuple[int, list[dict[str, float]]]:
    """Load the state of an unfinished run of the same identity; return the next step and the curve so far."""
    try:
        state: dict[str, Any] = torch.load(state_file, weights_only=True)
    except FileNotFoundError:
        return 0, []
    except Exception as error:  # torch names no exception for a file that is not one of its own
        print(f"{state_file} cannot be read ({type(error).__name__}); training begins anew.")
        return 0, []
    if state["identity"] != identity:
        return 0, []
    model.load_state_dict(state["model"])
    average.load_state_dict(state["average"])
    optimizer.load_state_dict(state["optimizer"])
    return state["step"], state["history"]
