"""Numpy's door to the energy kernel: batches of grasps, and their evaluation before one object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute.warp import warp
from pipeline.energy import kernel
from pipeline.energy.arrays import hand_arrays, object_arrays
from pipeline.energy.keep_out import fingers_used
from pipeline.hand.model import Hand
from pipeline.records.energy_terms import WEIGHTS, Terms, weights
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters


@dataclass
class Grasps:
    """A batch of grasps; object frame, SI units."""

    position: NDArray[np.float64]  # (B, 3) of the hand frame's origin
    rotation: NDArray[np.float64]  # (B, 4) wxyz
    q: NDArray[np.float64]  # (B, J)
    contacts: NDArray[np.int64]  # (B, n) indices into Hand.contact_points

    def __len__(self) -> int:
        return len(self.position)


def compile_kernels(device: str = "cpu") -> None:
    """Compile the kernels for a device, or load them from Warp's cache."""
    warp().load_module(kernel, device=device)


class EnergyScene:
    """One object in one style on one device, ready to evaluate and move grasps."""

    def __init__(
        self,
        prepared: PreparedObject,
        energy: EnergyParameters,
        style: StyleParameters,
        hand: Hand,
        device: str = "cpu",
    ) -> None:
        """Put ``prepared`` before ``hand``."""
        self.wp = warp()
        self.kernel = kernel
        self.device = device
        keep_out_for = None if style.keep_out_margin is None else fingers_used(style.finger_sets)
        self.joint_count = hand.joint_count
        self.hand = hand_arrays(hand, device, energy.hand_points, style.mount_clearance is not None, keep_out_for)
        self.scene = object_arrays(device, prepared, energy, style)
        self.balance_forces = energy.balance_forces
        self.term_weights = weights(energy, style)

    def weights(self) -> Any:
        """Return ``kernel.Weights``."""
        found = self.kernel.Weights()
        for name, weight in self.term_weights.items():
            setattr(found, name, weight)
        found.balance_forces = int(self.balance_forces)
        return found

    def states(self, grasps: Grasps) -> Any:
        """Return ``kernel.States`` holding a batch; energies and gradients are still zero."""
        wp, count = self.wp, len(grasps)
        states = self.kernel.States()
        states.position = wp.array(grasps.position.astype(np.float32), dtype=wp.vec3, device=self.device)
        xyzw = np.roll(grasps.rotation, -1, axis=1)
        states.rotation = wp.array(xyzw.astype(np.float32), dtype=wp.quat, device=self.device)
        states.q = wp.array(grasps.q.astype(np.float32), dtype=float, device=self.device)
        states.contacts = wp.array(grasps.contacts.astype(np.int32), dtype=int, device=self.device)
        states.terms = wp.zeros((count, len(WEIGHTS)), dtype=float, device=self.device)
        states.energy = wp.zeros(count, dtype=float, device=self.device)
        states.gradient = wp.zeros((count, self.kernel.POSE + self.joint_count), dtype=float, device=self.device)
        return states

    def scratch(self, grasps: Grasps) -> Any:
        """Return working memory for a batch."""
        wp, count, scratch = self.wp, len(grasps), self.kernel.Scratch()
        links, parts = self.hand.link_count, self.hand.part_count
        scratch.rotation = wp.zeros((count, links), dtype=wp.mat33, device=self.device)
        for name in ("position", "force", "moment"):
            setattr(scratch, name, wp.zeros((count, links), dtype=wp.vec3, device=self.device))
        scratch.part_position = wp.zeros((count, parts), dtype=wp.vec3, device=self.device)
        scratch.near = wp.zeros((count, parts), dtype=int, device=self.device)
        scratch.normal = wp.zeros((count, grasps.contacts.shape[1]), dtype=wp.vec3, device=self.device)
        return scratch

    def launch_evaluation(self, states: Any, scratch: Any, weights: Any) -> None:
        """Compute terms, energies and gradients of states in place."""
        self.wp.launch(
            self.kernel.evaluate_kernel,
            dim=states.energy.shape[0],
            inputs=[self.hand, self.scene, weights, states, scratch],
            device=self.device,
        )

    def evaluate(self, grasps: Grasps) -> tuple[Terms, NDArray[np.float64]]:
        """Return terms and gradients (B, 6 + J) of a batch; degrees of freedom as in ``kernel``."""
        states = self.states(grasps)
        self.launch_evaluation(states, self.scratch(grasps), self.weights())
        return read_terms(states), states.gradient.numpy().astype(np.float64)


def read_terms(states: Any) -> Terms:
    """Return the terms held by states."""
    return Terms(states.energy.numpy().astype(np.float64), *states.terms.numpy().astype(np.float64).T)


def read_grasps(states: Any) -> Grasps:
    """Return the grasps held by states."""
    return Grasps(
        position=states.position.numpy().astype(np.float64),
        rotation=np.roll(states.rotation.numpy().astype(np.float64), 1, axis=1),
        q=states.q.numpy().astype(np.float64),
        contacts=states.contacts.numpy().astype(np.int64),
    )


def chosen(grasps: Grasps, rows: Sequence[int] | NDArray[np.int64]) -> Grasps:
    """Return some grasps of a batch, in the order of ``rows``."""
    index = np.asarray(rows, dtype=np.int64)
    return Grasps(grasps.position[index], grasps.rotation[index], grasps.q[index], grasps.contacts[index])
