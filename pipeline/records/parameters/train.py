"""`train`: the learned model of two-object grasps, its training, and how its samples become grasps."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section

View = Literal["whole", "single"]
Level = Annotated[list[int], Field(min_length=3, max_length=3)]


class TrainDataParameters(Section):
    """What the model is trained on, and what is held out."""

    held_out: float = Field(
        0.05,
        ge=0,
        le=0.5,
        description="Fraction of each object's single-object grasps that no training example contains. Paper's code: "
        "0.",
    )
    held_out_pairs: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(
        [], description="Pairs, as [first, second], that the model is not trained on. Paper's code: none."
    )
    held_out_objects: list[str] = Field(
        [],
        description="Objects that the model is not trained on. While new objects are listed here, the model and its "
        "grasps of all other objects stay unchanged. Paper's code: none.",
    )
    held_out_sources: list[str] = Field(
        [],
        description="Sources under `assets` whose objects the model is not trained on, like those of held_out_objects.",
    )
    held_out_share: float = Field(
        0.0,
        ge=0,
        le=0.9,
        description="Fraction of all objects that the model is not trained on, drawn from the seed one by one; all "
        "resting poses of a mesh together.",
    )
    view: View = Field(
        "whole",
        description="What the model sees of an object, in training and in sampling: points all around it (`whole`), or "
        "what one depth camera at 0.8 m sees (`single`). Paper: whole.",
    )
    normalise: bool = Field(
        True, description="Normalise each dimension of a grasp to zero mean and unit variance. Paper's code: false."
    )
    cloud_noise: float = Field(
        0.001,
        ge=0,
        le=0.01,
        description="[m] Standard deviation of the noise on the point clouds in training. Paper's code: 0.",
    )
    yaw_augmentation: bool = Field(
        False,
        description="Rotate object frames about the vertical by random angles in training. Paper's code: false, and "
        "incorrect if enabled.",
    )

    @model_validator(mode="after")
    def _turned_once(self) -> Self:
        if self.yaw_augmentation and self.view == "single":
            raise ValueError("yaw_augmentation turns frames that a single view turns to the camera; set one of them")
        return self


class EncoderParameters(Section):
    """PointNet++: three set abstractions, each coarser than the last; the final centres are the tokens."""

    points: int = Field(
        512, ge=16, le=4096, description="Number of surface points that the model sees of an object. Paper: 1024."
    )
    clouds: int = Field(
        256,
        ge=1,
        le=1024,
        description="Number of point clouds stored per object; as few as 4 are memorised. Paper: a new cloud for every "
        "example.",
    )
    centres: Level = Field(
        [64, 32, 16], description="Number of centres after each set abstraction. Paper: 128, 64, 32."
    )
    radii: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(
        [0.02, 0.04, 0.08],
        description="[m] Radius of the neighbourhoods in each set abstraction. Paper: 0.02, 0.04, 0.08.",
    )
    neighbours: Level = Field(
        [16, 16, 16], description="Number of neighbours per centre in each set abstraction. Paper: 32, 32, 16."
    )
    widths: Level = Field(
        [32, 64, 128], description="Number of features after each set abstraction. Paper: 64, 128, 256."
    )

    @model_validator(mode="after")
    def _coarser(self) -> Self:
        counts = [self.points, *self.centres]
        if counts != sorted(counts, reverse=True):
            raise ValueError("centres must not increase from one set abstraction to the next, nor exceed points")
        return self


class DenoiserParameters(Section):
    """The network that makes its prediction from a noisy grasp and the features of both objects."""

    kind: Literal["mlp", "attention"] = Field(
        "mlp",
        description="Architecture: `mlp` pools the features of each object, `attention` attends to all of their "
        "tokens. Paper: attention.",
    )
    width: int = Field(
        256, ge=8, le=2048, description="Width of the denoiser's layers. Paper: 256, and 512 within the attention."
    )
    blocks: int = Field(3, ge=1, le=24, description="Number of residual blocks in the denoiser. Paper: 3.")
    slot_width: int = Field(
        32, ge=1, le=256, description="Size of the learned embedding that tells object 0 from object 1. Paper: 32."
    )


class DiffusionParameters(Section):
    """How noise is added, and what is predicted."""

    objective: Literal["clean", "epsilon", "flow"] = Field(
        "flow",
        description="What the denoiser predicts: the clean grasp (`clean`), the noise (`epsilon`), or the difference "
        "between the two, with a straight line from one to the other (`flow`). Paper: epsilon.",
    )
    schedule: Literal["cosine", "published"] = Field(
        "cosine",
        description="Noise schedule of the objectives clean and epsilon; flow has its own. `published` is the paper's: "
        "100 linear betas up to 0.01, which never reach pure noise.",
    )


class OptimizationParameters(Section):
    """The training loop."""

    device: Literal["cpu", "cuda"] = Field("cpu", description="Device to train on; `cuda` is untested.")
    threads: int = Field(
        1,
        ge=1,
        le=64,
        description="Number of CPU threads. It changes the weights, because sums round differently when they are split "
        "among threads.",
    )
    steps: int = Field(2500, ge=1, le=10_000_000, description="Number of training steps. Paper: 500 epochs.")
    batch: int = Field(128, ge=2, le=4096, description="Number of examples per training step. Paper: 512.")
    learning_rate: float = Field(1e-3, gt=0, le=0.1, description="Initial learning rate. Paper: 3e-4.")
    last_learning_rate: float = Field(
        1e-5, gt=0, le=0.1, description="Final learning rate, reached by cosine annealing. Paper: 1e-5."
    )
    weight_decay: float = Field(
        0.01, ge=0, le=1, description="Weight decay of AdamW. Paper's code: 0.01, the default of AdamW."
    )
    gradient_clip: float | None = Field(
        1.0, gt=0, description="Norm to which gradients are clipped; null disables clipping. Paper's code: null."
    )
    ema_decay: float = Field(
        0.998,
        ge=0,
        lt=1,
        description="Decay rate of the exponential moving average of the weights; 0 disables averaging. Paper's code: "
        "0.",
    )
    record_every: int = Field(
        100,
        ge=1,
        description="Number of training steps between records of the losses. An interrupted run resumes from the last "
        "record.",
    )


class SamplingParameters(Section):
    """From noise to grasps that a robot can try; every step after sampling can be switched off."""

    sampler: Literal["ddim", "ancestral", "dpm"] = Field(
        "ancestral",
        description="Sampling method: `ddim` is deterministic, `ancestral` adds noise at every step, `dpm` is the "
        "second-order DPM-Solver++. Paper: ancestral.",
    )
    steps: int = Field(20, ge=2, le=1000, description="Number of denoising steps per sample. Paper: 100.")
    draws: int = Field(
        96, ge=1, le=100_000, description="Number of samples drawn per pair. Paper's code: 32, of which it uses 25."
    )
    grasps: int = Field(40, ge=1, le=100_000, description="Accepted two-object grasps wanted per pair.")
    refine_iterations: int = Field(
        40,
        ge=0,
        le=10_000,
        description="Gradient steps that refine each sample by the grasp energies of both objects; 0 skips "
        "them. Paper: "
        "0.",
    )
    refine_step: float = Field(0.0005, gt=0, le=0.1, description="[m, rad] Initial step size of the refinement.")
    rank: bool = Field(
        True,
        description="Try samples in the order of their energy, lowest first, rather than as drawn. Paper: false.",
    )
    check: bool = Field(True, description="Reject samples that fail the geometric checks of `merge`. Paper: false.")
    physics: bool = Field(
        True,
        description="Reject samples that do not hold both objects in physics, tested as by `merge`: a squeeze, then "
        "gravity from all directions. Paper: false.",
    )


class TrainingParameters(Section):
    """Everything that the trained model depends on."""

    data: TrainDataParameters
    encoder: EncoderParameters
    denoiser: DenoiserParameters
    diffusion: DiffusionParameters
    optimization: OptimizationParameters


class TrainParameters(TrainingParameters):
    """The training, and the use of the trained model."""

    sampling: SamplingParameters
