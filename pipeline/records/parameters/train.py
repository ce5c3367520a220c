"""`train`: the learned model of two-object grasps, how it is trained, and how samples become grasps."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section

Level = Annotated[list[int], Field(min_length=3, max_length=3)]


class TrainDataParameters(Section):
    """What the model learns from, and what is kept from it."""

    held_out: float = Field(
        0.05,
        ge=0,
        le=0.5,
        description="Share of each object's single grasps that no training example has a part in. Paper's code: 0.",
    )
    held_out_pairs: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(
        [], description="Pairs, [first, second], that are never trained together. Paper's code: none."
    )
    held_out_objects: list[str] = Field(
        [],
        description="Objects of which the model learns nothing. As long as new objects are here, the model stays what "
        "it is, and with it its grasps of all other objects. Paper's code: none.",
    )
    normalise: bool = Field(True, description="Zero mean and unit variance per dimension. Paper's code: off.")
    cloud_noise: float = Field(
        0.001, ge=0, le=0.01, description="Standard deviation of noise on the points, m. Paper's code: none."
    )
    yaw_augmentation: bool = Field(
        False, description="Turn object frames about z at random. Paper's code: off, and wrong if switched on."
    )


class EncoderParameters(Section):
    """PointNet++: three set abstractions, coarser from level to level; tokens are the centres of the last one."""

    points: int = Field(512, ge=16, le=4096, description="Surface points that the model sees. Paper: 1024.")
    clouds: int = Field(
        256,
        ge=1,
        le=1024,
        description="Stored draws of them per object; 4 are learned by heart. Paper: one per example.",
    )
    centres: Level = Field([64, 32, 16], description="Paper: 128, 64, 32.")
    radii: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        [0.02, 0.04, 0.08], description="Of neighbourhoods, m. Paper: 0.02, 0.04, 0.08."
    )
    neighbours: Level = Field([16, 16, 16], description="Paper: 32, 32, 16.")
    widths: Level = Field([32, 64, 128], description="Features per level. Paper: 64, 128, 256.")

    @model_validator(mode="after")
    def _coarser(self) -> Self:
        counts = [self.points, *self.centres]
        if counts != sorted(counts, reverse=True):
            raise ValueError("centres must not grow from points to the last level")
        return self


class DenoiserParameters(Section):
    """The network that predicts from a noisy grasp and the features of both objects."""

    kind: Literal["mlp", "attention"] = Field(
        "mlp", description="mlp: features of an object are pooled. attention: the paper's, over all of its tokens."
    )
    width: int = Field(256, ge=8, le=2048, description="Paper: 256, inside of attention 512.")
    blocks: int = Field(3, ge=1, le=24, description="Paper: 3.")
    slot_width: int = Field(32, ge=1, le=256, description="Embedding that tells object 0 from object 1. Paper: 32.")


class DiffusionParameters(Section):
    """How noise is added, and what is predicted."""

    objective: Literal["clean", "epsilon", "flow"] = Field(
        "flow", description="Prediction of the clean grasp, of the noise (paper), or of their difference on a line."
    )
    schedule: Literal["cosine", "published"] = Field(
        "cosine",
        description="published: 100 linear betas up to 0.01, which never reach noise. `flow` has its own, a line.",
    )


class OptimizationParameters(Section):
    """The training loop."""

    device: Literal["cpu", "cuda"] = Field("cpu", description="cuda has not been tested.")
    threads: int = Field(1, ge=1, le=64, description="Sums round differently when split, so this changes weights.")
    steps: int = Field(4000, ge=1, le=10_000_000, description="Paper: 500 epochs.")
    batch: int = Field(128, ge=2, le=4096, description="Paper: 512.")
    learning_rate: float = Field(1e-3, gt=0, le=0.1, description="At the start. Paper: 3e-4.")
    last_learning_rate: float = Field(1e-5, gt=0, le=0.1, description="At the end of a cosine. Paper: 1e-5.")
    weight_decay: float = Field(0.01, ge=0, le=1, description="Paper's code: 0.01, AdamW's own.")
    gradient_clip: float | None = Field(1.0, gt=0, description="Largest norm of a gradient. Paper's code: none.")
    ema_decay: float = Field(0.998, ge=0, lt=1, description="Memory of the averaged weights. Paper's code: none.")
    record_every: int = Field(200, ge=1, description="Steps between points of the curve; a killed run resumes there.")


class SamplingParameters(Section):
    """From noise to grasps that a robot can try; every step can be switched off."""

    sampler: Literal["ddim", "ancestral", "dpm"] = Field(
        "ancestral", description="Without noise, with noise on the way (paper), or second order (DPM-Solver++)."
    )
    steps: int = Field(20, ge=2, le=1000, description="Evaluations of the network per sample. Paper: 100.")
    draws: int = Field(
        96, ge=1, le=100_000, description="Samples drawn per pair. Paper's code: 32, of which it uses 25."
    )
    grasps: int = Field(40, ge=1, le=100_000, description="Accepted grasps wanted per pair.")
    refine_iterations: int = Field(
        40, ge=0, le=10_000, description="Steps down the grasp energy of both objects; 0: none. Paper: none."
    )
    refine_step: float = Field(0.0005, gt=0, le=0.1, description="First of these steps, m and rad.")
    rank: bool = Field(True, description="Try grasps of low energy first; else in the order drawn. Paper: no ranking.")
    check: bool = Field(True, description="Refuse what the checks of `merge` refuse. Paper: none.")
    physics: bool = Field(True, description="Squeeze and hold in six gravities, as `merge` does. Paper: none.")


class TrainingParameters(Section):
    """Everything on which the trained model depends."""

    data: TrainDataParameters
    encoder: EncoderParameters
    denoiser: DenoiserParameters
    diffusion: DiffusionParameters
    optimization: OptimizationParameters


class TrainParameters(TrainingParameters):
    """The training, and the use of its result."""

    sampling: SamplingParameters
