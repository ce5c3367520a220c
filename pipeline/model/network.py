"""The network: PointNet++ for each object, a denoiser for the grasp.

Shapes: B grasps of D numbers, C clouds, P pairs of clouds.

Many grasps of a batch share their objects, so each distinct cloud is encoded once and its features are gathered by
index; with 4 to 16 clouds and hundreds of grasps that is most of the cost of a step.

The published denoiser attends to the tokens of both objects and to itself. The sequence is one token long, so that its
self-attention is a linear map and is left out here; ``kind: attention`` keeps everything else of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.model.clouds import Clouds
from pipeline.model.held_out import STYLES
from pipeline.records.parameters.train import DenoiserParameters, EncoderParameters

# Positions enter as sines and cosines of these wave numbers, 1/m (wavelengths 21 cm to 2.6 cm). With them, and with
# calibrated features (below), the loss was 0.228 after 2000 steps at demo scale, with coordinates alone 0.273.
WAVE_NUMBERS = (30.0, 60.0, 120.0, 240.0)
LEAST_SPREAD = 0.01  # of a feature over objects, below which it is not blown up
TIME_WIDTH = 64
HEAD = 64  # width of one attention head, as published


@dataclass(frozen=True)
class CloudTensors:
    """``Clouds`` on a device."""

    points: Tensor  # (C, n, 3) float32, m
    neighbours: tuple[Tensor, ...]  # per level (C, centres, k) int64

    def chosen(self, index: Tensor) -> CloudTensors:
        """Return some of the clouds."""
        return CloudTensors(self.points[index], tuple(level[index] for level in self.neighbours))

    def to(self, device: str | torch.device) -> CloudTensors:
        """Return the clouds on another device."""
        return CloudTensors(self.points.to(device), tuple(level.to(device) for level in self.neighbours))


def cloud_tensors(clouds: Clouds, device: str | torch.device = "cpu") -> CloudTensors:
    """Copy clouds to a device."""
    neighbours = tuple(torch.as_tensor(level, device=device) for level in clouds.neighbours)
    return CloudTensors(torch.as_tensor(clouds.points, device=device), neighbours)


def _gather(values: Tensor, index: Tensor) -> Tensor:
    """Return values (C, m, f) at index (C, c, k) as (C, c, k, f)."""
    C, c, k = index.shape
    flat = index.reshape(C, c * k, 1).expand(-1, -1, values.shape[-1])
    return torch.gather(values, 1, flat).reshape(C, c, k, -1)


class Encoder(nn.Module):
    """PointNet++ with three set abstractions (Qi et al. 2017): clouds to ``centres[2]`` tokens each.

    A centre's feature is the maximum over its neighbours of a small network on (relative position / radius, feature).
    Layer normalisation stands where the paper has batch normalisation, whose statistics over 4 to 16 clouds are noise.
    """

    def __init__(self, settings: EncoderParameters) -> None:
        super().__init__()
        self.radii = settings.radii
        self.levels = nn.ModuleList()
        before = 6 * len(WAVE_NUMBERS)
        for width in settings.widths:
            self.levels.append(
                nn.Sequential(
                    nn.Linear(3 + before, width),
                    nn.LayerNorm(width),
                    nn.ReLU(),
                    nn.Linear(width, width),
                    nn.LayerNorm(width),
                    nn.ReLU(),
                )
            )
            before = width

    def forward(self, clouds: CloudTensors) -> Tensor:
        """Return tokens (C, centres[2], widths[2])."""
        position = clouds.points
        waves = torch.tensor(WAVE_NUMBERS, device=position.device)
        angle = (position[..., None] * waves).flatten(-2)
        feature = torch.cat([angle.sin(), angle.cos()], dim=-1)
        for level, radius, neighbours in zip(self.levels, self.radii, clouds.neighbours, strict=True):
            centre = position[:, : neighbours.shape[1]]
            relative = (_gather(position, neighbours) - centre[:, :, None]) / radius
            feature = level(torch.cat([relative, _gather(feature, neighbours)], dim=-1)).amax(2)
            position = centre
        return feature


class TimeEmbedding(nn.Module):
    """Sines of the diffusion time, 0 to 1, through a small network."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.network = nn.Sequential(nn.Linear(TIME_WIDTH, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, time: Tensor) -> Tensor:
        """Return features (B, width) of times (B,)."""
        frequency = torch.exp(torch.linspace(0.0, math.log(1000.0), TIME_WIDTH // 2, device=time.device))
        angle = time[:, None] * frequency
        return self.network(torch.cat([angle.sin(), angle.cos()], dim=-1))


class MlpDenoiser(nn.Module):
    """Residual blocks whose normalisation is scaled, shifted and gated by time and objects (adaLN, Peebles 2023)."""

    mean: Tensor
    spread: Tensor

    def __init__(self, settings: DenoiserParameters, token_width: int, dimensions: int) -> None:
        super().__init__()
        width, self.slot_width = settings.width, settings.slot_width
        self.time = TimeEmbedding(width)
        # Maximum and mean over the tokens of an object, with the slot's embedding, for each of the slots.
        self.context = nn.Sequential(
            nn.Linear(len(STYLES) * (2 * token_width + settings.slot_width), width),
            nn.SiLU(),
            nn.Linear(width, width),
        )
        # At first, pooled features of different objects hardly differ; see :meth:`calibrate`.
        self.register_buffer("mean", torch.zeros(2 * token_width))
        self.register_buffer("spread", torch.ones(2 * token_width))
        self.begin = nn.Linear(dimensions, width)
        self.norms = nn.ModuleList(nn.LayerNorm(width, elementwise_affine=False) for _ in range(settings.blocks))
        self.branches = nn.ModuleList(
            nn.Sequential(nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width))
            for _ in range(settings.blocks)
        )
        self.modulation = nn.Linear(width, 3 * width * settings.blocks)
        nn.init.zeros_(self.modulation.weight)  # every block begins as the identity
        nn.init.zeros_(self.modulation.bias)
        self.end = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, dimensions))

    def pool(self, tokens: Tensor) -> Tensor:
        """Return features (C, 2 f) of tokens (C, T, f)."""
        return torch.cat([tokens.amax(1), tokens.mean(1)], dim=-1)

    @torch.no_grad()
    def calibrate(self, tokens: Tensor) -> None:
        """Fix mean and spread of the pooled features over objects, of tokens (C, T, f), before the training begins."""
        pooled = self.pool(tokens)
        self.mean.copy_(pooled.mean(0))
        self.spread.copy_(pooled.std(0, correction=0).clamp(min=LEAST_SPREAD))

    def prepare(self, tokens: Sequence[Tensor]) -> Tensor:
        """Return what :meth:`forward` needs of P pairs, (P, width), from tokens (P, T, f + slot_width) per slot."""
        features = []
        for slot in tokens:
            own, embedding = slot[..., : -self.slot_width], slot[:, 0, -self.slot_width :]
            features += [(self.pool(own) - self.mean) / self.spread, embedding]
        return self.context(torch.cat(features, dim=-1))

    def forward(self, x: Tensor, time: Tensor, context: Tensor, pair: Tensor) -> Tensor:
        """Return predictions (B, D) for noisy x (B, D) at times (B,) given prepared pairs and pair indices (B,)."""
        condition = functional.silu(context[pair] + self.time(time))
        h = self.begin(x)
        modulations = self.modulation(condition).chunk(len(self.branches), dim=-1)
        for norm, branch, modulation in zip(self.norms, self.branches, modulations, strict=True):
            scale, shift, gate = modulation.chunk(3, dim=-1)
            h = h + gate * branch((1 + scale) * norm(h) + shift)
        return self.end(h)


class CrossAttention(nn.Module):
    """One layer of the published transformer: cross-attention to the tokens, then a gated feed-forward (GEGLU)."""

    def __init__(self, inner: int, context: int) -> None:
        super().__init__()
        self.heads = max(inner // HEAD, 1)
        self.query_norm = nn.LayerNorm(inner)
        self.query = nn.Linear(inner, inner, bias=False)
        self.key = nn.Linear(context, inner, bias=False)
        self.value = nn.Linear(context, inner, bias=False)
        self.project = nn.Linear(inner, inner)
        self.norm = nn.LayerNorm(inner)
        self.widen = nn.Linear(inner, 4 * inner)  # twice the width, as values and as gates
        self.narrow = nn.Linear(2 * inner, inner)

    def split(self, values: Tensor) -> Tensor:
        """(B, T, inner) to (B, heads, T, head)."""
        return values.unflatten(-1, (self.heads, -1)).transpose(1, 2)

    def forward(self, y: Tensor, keys: Tensor, values: Tensor) -> Tensor:
        """Return y (B, inner) after one layer; keys and values (B, heads, T, head)."""
        query = self.split(self.query(self.query_norm(y))[:, None])
        y = y + self.project(functional.scaled_dot_product_attention(query, keys, values).flatten(1))
        value, gate = self.widen(self.norm(y)).chunk(2, dim=-1)
        return y + self.narrow(value * functional.gelu(gate))


class AttentionBlock(nn.Module):
    """A residual block with time, then two layers of cross-attention."""

    def __init__(self, width: int, inner: int, context: int) -> None:
        super().__init__()
        self.first = nn.Sequential(nn.GroupNorm(_groups(width), width), nn.SiLU(), nn.Linear(width, width))
        self.time = nn.Sequential(nn.SiLU(), nn.Linear(2 * width, width))
        self.second = nn.Sequential(nn.GroupNorm(_groups(width), width), nn.SiLU(), nn.Linear(width, width))
        self.begin, self.end = nn.Linear(width, inner), nn.Linear(inner, width)
        self.layers = nn.ModuleList([CrossAttention(inner, context), CrossAttention(inner, context)])


class AttentionDenoiser(nn.Module):
    """The published denoiser without its self-attention: residual blocks with time, cross-attention to all tokens."""

    def __init__(self, settings: DenoiserParameters, token_width: int, dimensions: int) -> None:
        super().__init__()
        width, context = settings.width, token_width + settings.slot_width
        self.time = TimeEmbedding(2 * width)
        self.begin = nn.Linear(dimensions, width)
        self.blocks = nn.ModuleList([AttentionBlock(width, 2 * width, context) for _ in range(settings.blocks)])
        self.end = nn.Sequential(nn.GroupNorm(_groups(width), width), nn.SiLU(), nn.Linear(width, dimensions))

    def prepare(self, tokens: Sequence[Tensor]) -> Tensor:
        """Return keys and values (layers, 2, P, heads, 2 T, head) of P pairs, from tokens (P, T, f + slot_width)."""
        joined = torch.cat(list(tokens), dim=1)
        layers = [layer for block in self.blocks for layer in block.layers]  # type: ignore[union-attr]
        return torch.stack(
            [torch.stack([layer.split(layer.key(joined)), layer.split(layer.value(joined))]) for layer in layers]
        )

    def forward(self, x: Tensor, time: Tensor, context: Tensor, pair: Tensor) -> Tensor:
        """Return predictions (B, D); see :meth:`MlpDenoiser.forward`."""
        embedded = self.time(time)
        h = self.begin(x)
        prepared = iter(context)
        for block in self.blocks:
            assert isinstance(block, AttentionBlock)
            h = h + block.second(block.first(h) + block.time(embedded))
            y = block.begin(h)
            for layer in block.layers:
                keys, values = next(prepared)
                y = layer(y, keys[pair], values[pair])
            h = h + block.end(y)
        return self.end(h)


def _groups(width: int) -> int:
    """Groups of a group normalisation, of 8 channels each: 32 at the published width."""
    return math.gcd(width, max(width // 8, 1))


class GraspModel(nn.Module):
    """Encoder, slot embedding and denoiser."""

    def __init__(self, encoder: EncoderParameters, denoiser: DenoiserParameters, dimensions: int) -> None:
        """Make the network for grasps of ``dimensions`` numbers, see ``model.representation``."""
        super().__init__()
        self.encoder = Encoder(encoder)
        self.slot = nn.Parameter(torch.randn(len(STYLES), denoiser.slot_width))  # how an object is held
        kind = MlpDenoiser if denoiser.kind == "mlp" else AttentionDenoiser
        self.denoiser = kind(denoiser, encoder.widths[-1], dimensions)

    def calibrate(self, clouds: CloudTensors) -> None:
        """Look at clouds of all objects once before the training begins."""
        if isinstance(self.denoiser, MlpDenoiser):
            self.denoiser.calibrate(self.encoder(clouds))

    def context(self, clouds: CloudTensors, pairs: Tensor) -> Tensor:
        """Return what the denoiser needs to know of P pairs; every cloud is encoded once.

        Args:
            pairs: (P, n) int64, indices into ``clouds`` of the objects in the order of picking.
        """
        tokens = self.encoder(clouds)
        slots = []
        for slot, embedding in enumerate(self.slot):
            own = tokens[pairs[:, slot]]
            slots.append(torch.cat([own, embedding.expand(*own.shape[:2], -1)], dim=-1))
        return self.denoiser.prepare(slots)

    def forward(self, x: Tensor, time: Tensor, context: Tensor, pair: Tensor) -> Tensor:
        """Return the prediction (B, D) from noisy, normalised grasps x (B, D) at times (B,) in 0..1.

        Args:
            context: of :meth:`context`.
            pair: (B,) int64, the pair of each grasp.
        """
        return self.denoiser(x, time, context, pair)
