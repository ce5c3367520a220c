"""The whole preparation of one object, from raw triangles to the record that other stages load."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from pipeline.compute.guard import CallLost, guarded
from pipeline.prepare import change, repair, resolution, resting, sources
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.objects import RESTING, FileShape
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes import convex_parts, frame, mass, samples
from pipeline.stages.seeds import item_generator

CPU_SECONDS, MEGABYTES = 90, 8000  # that everything but the convex parts may take


def _union_volume(parts: list[convex_parts.Mesh]) -> float:
    """Volume of the union of convex parts, m3."""
    solids = [manifold3d.Manifold.hull_points(vertices) for vertices, _ in parts]
    return float(manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).volume())


def _falls_over(name: str, up: str, standing: resting.Stance, solid: repair.Solid) -> UserError:
    """Return the refusal of an object that does not stand, with what would help."""
    others = [
        axis
        for axis in frame.ROTATIONS
        if resting.stance(frame.canonical_vertices(solid.vertices, solid.faces, axis)).firm
    ]
    advice = f"set `up` to {' or '.join(others)}" if others else "give it a flat base or turn the mesh"
    return UserError(
        f"{name}: the object does not stand with {up} up (its centre of mass is "
        f"{1000 * standing.margin:.1f} mm inside its support, {1000 * resting.SMALLEST_MARGIN:g} are needed); {advice}."
    )


@dataclass(frozen=True)
class _Shape:
    """The solid of an object in its own frame, and what is sampled from it."""

    solid: repair.Solid
    up: str
    vertices: NDArray[np.float64]
    standing: resting.Stance
    pose_probability: float | None  # that it comes to rest like that; None where `up` was given
    grid: resolution.Resolved
    changed: change.Change
    surface: NDArray[np.float32]


def _stood(
    name: str, solid: repair.Solid, shape: sources.Shape, up: str, must_stand: bool
) -> tuple[NDArray[np.float64], resting.Stance, float | None]:
    """Return the vertices in the object's frame, how it stands, and how probable that is where nobody chose it.

    Raises:
        UserError: it does not stand, although it must.
    """
    turn = shape.turn
    if up == RESTING:
        return _come_to_rest(name, solid, shape.pose or 1, turn)
    vertices = frame.canonical_vertices(solid.vertices, solid.faces, up, turn)
    standing = resting.stance(vertices)
    if must_stand and not standing.firm:
        raise _falls_over(name, up, standing, solid)
    return vertices, standing, None


def _come_to_rest(
    name: str, solid: repair.Solid, pose: int, turn: float | None
) -> tuple[NDArray[np.float64], resting.Stance, float]:
    """Return what :func:`_stood` does for a pose in which the solid comes to rest.

    Args:
        pose: its number among those of :func:`pipeline.prepare.resting.poses`, from 1.

    Raises:
        UserError: there are not so many.
    """
    _, centre, _ = mass.solid_properties(solid.vertices, solid.faces)
    poses = resting.poses(solid.vertices - centre, most=pose)
    if len(poses) < pose:
        raise UserError(f"{name}: the solid stands in {len(poses)} poses, so there is no pose {pose}; name another.")
    R, probability = poses[pose - 1]
    vertices = frame.canonical_vertices((solid.vertices - centre) @ R.T, solid.faces, "+z", turn)
    return vertices, resting.stance(vertices), round(probability, 4)


def _repaired(
    name: str, raw: sources.RawMesh, wishes: repair.Wishes, accept: bool
) -> tuple[repair.Solid, change.Change]:
    """Return the solid that triangles are made, and what that changed.

    Raises:
        UserError: it is none, or of another shape although nobody accepted that.
    """
    solid = repair.repair(raw.vertices, raw.faces, name, wishes)
    changed = change.compared((raw.vertices, raw.faces), (solid.vertices, solid.faces))
    if not accept and wishes.wall is None:
        change.check(changed, solid.open_in_file, name, whole=wishes.bodies == "refuse")
    return solid, changed


def _shaped(
    name: str,
    raw: sources.RawMesh,
    shape: sources.Shape,
    parameters: PrepareParameters,
    must_stand: bool,
) -> _Shape:
    """Make one solid of triangles, stand it up, and sample it.

    Raises:
        UserError: it cannot be one solid that stands, or only by changing its shape beyond the limits.
    """
    up = shape.up or raw.up
    accept = False
    wishes = repair.Wishes()
    if isinstance(shape, FileShape):
        wishes, accept = repair.Wishes(shape.bodies, shape.wall), shape.accept_repair
    solid, changed = _repaired(name, raw, wishes, accept)
    vertices, standing, probability = _stood(name, solid, shape, up, must_stand)
    grid = resolution.resolved(vertices, solid.faces, parameters)
    if grid.passes_through_itself:
        solid, changed = _repaired(name, raw, replace(wishes, rebuild=True), accept)
        vertices, standing, probability = _stood(name, solid, shape, up, must_stand)
        grid = resolution.resolved(vertices, solid.faces, parameters)
    if not accept:
        resolution.check(grid, name)
    # Seeded by the name alone: another run seed must not change what the objects are.
    surface = samples.surface_samples(
        vertices, solid.faces, parameters.surface_points, item_generator(0, "prepare", name)
    )
    return _Shape(solid, up, vertices, standing, probability, grid, changed, surface)


def prepare_object(
    name: str,
    shape: sources.Shape,
    parameters: PrepareParameters,
    raw: sources.RawMesh | None = None,
    must_stand: bool = True,
) -> PreparedObject:
    """Return the prepared object.

    What reads the triangles runs in a process of its own, so that a crash of a library is an error like others.

    Args:
        raw: its triangles, where they have been read already.
        must_stand: refuse an object that does not stand with its ``up`` axis upward.

    Raises:
        UserError: the source is missing or cannot become one solid that stands with its ``up`` axis upward.
    """
    raw = raw or sources.raw_mesh(shape, name)
    try:
        made = guarded(_shaped, name, raw, shape, parameters, must_stand, cpu_seconds=CPU_SECONDS, megabytes=MEGABYTES)
    except CallLost as lost:
        raise UserError(
            f"{name}: no solid can be made of the mesh (repair {lost}); simplify or mend it in a modeller."
        ) from lost
    solid, vertices, faces = made.solid, made.vertices, made.solid.faces
    volume, _, inertia = mass.solid_properties(vertices, faces)
    parts, parts_lost, remark = convex_parts.convex_parts(vertices, faces, parameters)
    repairs = [*solid.repairs, *made.grid.remarks, *([remark] if remark else [])]
    return PreparedObject(
        name=name,
        vertices=vertices,
        faces=faces,
        parts=tuple(parts),
        distance=made.grid.grid.values,
        distance_origin=made.grid.grid.origin,
        distance_spacing=made.grid.grid.spacing,
        surface_points=made.surface[:, :3].astype(np.float64),
        surface_normals=made.surface[:, 3:].astype(np.float64),
        mass=volume * shape.density,
        inertia=inertia * shape.density,
        volume=volume,
        extents=np.ptp(vertices, axis=0),
        provenance=_remarks(raw, made)
        | {
            "source": raw.source,
            "licence": raw.licence,
            "repairs": repairs,
            "raw_faces": len(raw.faces),
            "faces": len(faces),
            "hull_volume": mass.solid_properties(*convex_parts.convex_hull(vertices))[0],
            "parts_volume": _union_volume(parts),
            "parts_lost_depth": parts_lost,
            "density": shape.density,
            "stance_margin": made.standing.margin,
            "stance_tip_degrees": float(np.degrees(made.standing.tip_angle)),
            "stable_poses": resting.stable_poses(vertices),
        },
    )


def _remarks(raw: sources.RawMesh, made: _Shape) -> dict[str, Any]:
    """Return what is recorded of those objects alone that it is true of."""
    found: dict[str, Any] = {}
    if raw.guessed_unit:
        found = {"guessed_unit": raw.guessed_unit, "longest_extent_in_file": raw.longest}
    if made.pose_probability is not None:
        found["pose_probability"] = made.pose_probability
    if made.changed.notable:
        found["changes"] = made.changed.record()
    return found
