"""The grasp energy written down densely in torch over pytorch_kinematics: slow, plain, float64, autograd.

Used by tests only. It shares with the kernel the hand's description and nothing else.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
import pytorch_kinematics
import torch

from pipeline.energy.keep_out import keep_out_points
from pipeline.hand.model import Hand
from pipeline.hand.surface import hand_surface, mount_surface
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters

DTYPE = torch.float64


def tensor(values) -> torch.Tensor:
    return torch.as_tensor(np.asarray(values), dtype=DTYPE)


@dataclass
class OracleResult:
    terms: dict[str, float]
    energy: float
    gradient: np.ndarray  # (6 + J,)
    kink_distance: float  # m, how far the nearest kink of the energy is


def skew(w: torch.Tensor) -> torch.Tensor:
    zero = torch.zeros((), dtype=DTYPE)
    return torch.stack([zero, -w[2], w[1], w[2], zero, -w[0], -w[1], w[0], zero]).reshape(3, 3)


class EnergyOracle:
    def __init__(self, prepared: PreparedObject, energy: EnergyParameters, style: StyleParameters, hand: Hand) -> None:
        self.prepared, self.energy, self.style, self.hand = prepared, energy, style, hand
        text = self.hand.urdf.read_bytes()
        self.chain = pytorch_kinematics.build_chain_from_urdf(text).to(dtype=DTYPE)
        mimics = {joint.get("name"): joint.find("mimic") for joint in ElementTree.fromstring(text).iter("joint")}
        order = self.chain.get_joint_parameter_names()
        drivers = [name if mimics[name] is None else mimics[name].get("joint") for name in order]
        self.columns = [self.hand.joint_names.index(name) for name in drivers]
        self.gain = tensor([1.0 if mimics[name] is None else float(mimics[name].get("multiplier")) for name in order])
        self.shift = tensor([0.0 if mimics[name] is None else float(mimics[name].get("offset")) for name in order])
        self.kinks: list[float] = []
        torch.set_num_threads(1)

    def links(self, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        poses = self.chain.forward_kinematics((self.gain * q[self.columns] + self.shift)[None])
        matrices = torch.stack([poses[name].get_matrix()[0] for name in self.hand.link_names])
        return matrices[:, :3, :3], matrices[:, :3, 3]

    def distance(self, p: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Trilinear signed distance with the distance to the grid added outside; its gradient as a constant."""
        grid = tensor(self.prepared.distance)
        leaf = p.detach().clone().requires_grad_(True)

        def value(points: torch.Tensor) -> torch.Tensor:
            x = (points - tensor(self.prepared.distance_origin)) / self.prepared.distance_spacing
            top = torch.tensor(grid.shape) - 1
            c = torch.minimum(torch.maximum(x, torch.zeros(3, dtype=DTYPE)), top.to(DTYPE))
            base = torch.minimum(c.detach().long(), top - 1)
            f = c - base
            within = (x == c).detach()
            if within.any():
                margin = torch.minimum(f, 1 - f).detach()[within].min()
                self.kinks.append(float(margin) * self.prepared.distance_spacing)
            total = torch.zeros(len(points), dtype=DTYPE)
            for i in (0, 1):
                for j in (0, 1):
                    for k in (0, 1):
                        w = (f[:, 0] if i else 1 - f[:, 0]) * (f[:, 1] if j else 1 - f[:, 1])
                        w = w * (f[:, 2] if k else 1 - f[:, 2])
                        total = total + w * grid[base[:, 0] + i, base[:, 1] + j, base[:, 2] + k]
            beyond = ((x - c) ** 2).sum(-1)
            far = torch.where(beyond > 0, beyond, torch.ones_like(beyond)).sqrt() * (beyond > 0)
            return total + far * self.prepared.distance_spacing

        (gradient,) = torch.autograd.grad(value(leaf).sum(), leaf)
        return value(p), gradient.detach()

    def depths(self, p: torch.Tensor, R: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
        """Depth (n, parts) of points in boxes, then spheres."""
        hand, columns = self.hand, []
        for link, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True):
            x = ((p - t[link]) @ R[link] - tensor(pose[:3, 3])) @ tensor(pose[:3, :3])
            margins = tensor(half) - x.abs()
            deep = margins.detach().sort(-1).values
            inside = deep[:, 0] > 0
            if inside.any():
                self.kinks.append(float((deep[inside, 1] - deep[inside, 0]).min()))
            columns.append(margins.min(-1).values)
        for link, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True):
            columns.append(radius - ((p - t[link]) @ R[link] - tensor(centre)).norm(dim=-1))
        return torch.stack(columns, -1)

    def deepest(self, depths: torch.Tensor) -> torch.Tensor:
        top = depths.detach().topk(2, dim=-1).values
        self.kinks.append(float(top[:, 0].abs().min()))
        if (top[:, 0] > 0).any():
            self.kinks.append(float((top[:, 0] - top[:, 1])[top[:, 0] > 0].min()))
        return depths.max(-1).values.clamp(min=0).sum()

    def __call__(self, position, rotation, q, contacts) -> OracleResult:
        """One grasp: (3,), (3, 3), (J,), (n,)."""
        self.kinks = []
        hand, energy, prepared = self.hand, self.energy, self.prepared
        dof = torch.zeros(6 + hand.joint_count, dtype=DTYPE, requires_grad=True)
        joints = tensor(q) + dof[6:]
        base = tensor(rotation) @ (torch.eye(3, dtype=DTYPE) + skew(dof[3:6]))  # first order of exp is enough at 0
        origin = tensor(position) + dof[:3]
        own_R, own_t = self.links(joints)
        R, t = base @ own_R, own_t @ base.T + origin

        contact_link = hand.contact_link[contacts]
        points = torch.einsum("nij,nj->ni", R[contact_link], tensor(hand.contact_points[contacts])) + t[contact_link]
        value, gradient = self.distance(points)
        self.kinks.append(float(value.detach().abs().min()))
        normals = gradient / gradient.norm(dim=-1, keepdim=True)
        opposing = np.array([hand.contact_finger[c] in hand.opposing for c in contacts])
        shares = np.ones(len(contacts))
        if energy.balance_forces and 0 < opposing.sum() < len(contacts):
            shares[opposing] = 0.5 * len(contacts) / opposing.sum()
            shares[~opposing] = 0.5 * len(contacts) / (~opposing).sum()
        forces = normals * tensor(shares)[:, None]
        scale = 2 / np.sort(prepared.extents)[1] if energy.scale_torque else 1.0
        torque = scale * torch.cross(points, forces, dim=-1).sum(0)
        closure = (forces.sum(0) ** 2).sum() + (torque**2).sum()
        distance = value.abs().sum()
        middle = (points * tensor(shares)[:, None]).sum(0) / len(contacts)
        offset = (middle**2).sum()

        surface = tensor(prepared.surface_points[: energy.object_points])
        penetration = self.deepest(self.depths(surface, R, t))

        link, local = hand_surface(energy.hand_points, hand)
        world = torch.einsum("nij,nj->ni", R[link], tensor(local)) + t[link]
        below = prepared.bottom + self.style.table_clearance - world[:, 2]
        table = below.clamp(min=0).sum()
        self.kinks.append(float(below.detach().abs().min()))
        if self.style.mount_clearance is not None:
            mount = tensor(mount_surface(hand)) @ base.T + origin
            below = prepared.bottom + self.style.mount_clearance - mount[:, 2]
            table = table + below.clamp(min=0).sum()
            self.kinks.append(float(below.detach().abs().min()))

        part_link = np.concatenate([hand.box_link, hand.sphere_link])
        touching = np.equal.outer(link, part_link)
        for child, parent in enumerate(hand.parent):
            touching |= np.logical_and.outer(link == child, part_link == parent)
            touching |= np.logical_and.outer(link == parent, part_link == child)
        for pair in hand.may_overlap:
            one, other = (hand.link(name) for name in pair)
            touching |= np.logical_and.outer(link == one, part_link == other)
            touching |= np.logical_and.outer(link == other, part_link == one)
        depths = torch.where(torch.as_tensor(touching), torch.full((), -1.0, dtype=DTYPE), self.depths(world, R, t))
        collision = self.deepest(depths)

        excess = (joints - tensor(hand.upper)).clamp(min=0).sum() + (tensor(hand.lower) - joints).clamp(min=0).sum()
        keep_out = torch.zeros((), dtype=DTYPE)
        if self.style.keep_out_margin is not None:
            fingers = {finger for fingers in self.style.finger_sets for finger in fingers}
            free = tensor(keep_out_points(tuple(sorted(fingers)), hand)) @ base.T + origin
            overlap = self.style.keep_out_margin - self.distance(free)[0]
            self.kinks.append(float(overlap.detach().abs().min()))
            own = [name for finger in fingers - {"palm"} for name in hand.finger_links[finger]]
            foreign = torch.as_tensor(~np.isin(part_link, [hand.link(name) for name in own]))
            depths = torch.where(foreign, torch.full((), -1.0, dtype=DTYPE), self.depths(free, R, t))
            keep_out = overlap.clamp(min=0).sum() + self.deepest(depths)

        weighted = {
            "force_closure": (closure, energy.weight_force_closure),
            "distance": (distance, energy.weight_distance),
            "penetration": (penetration, energy.weight_penetration),
            "table": (table, energy.weight_penetration),
            "self_penetration": (collision, energy.weight_self_penetration),
            "joints": (excess, energy.weight_joints),
            "offset": (offset, self.style.weight_offset),
            "keep_out": (keep_out, energy.weight_penetration),
        }
        total = torch.stack([weight * term for term, weight in weighted.values()]).sum()
        total.backward()
        terms = {name: float(term.detach()) for name, (term, _) in weighted.items()}
        return OracleResult(terms, float(total.detach()), dof.grad.numpy(), min(self.kinks))
