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
from pipeline.records.parameters.objects import MeshParameters, ObjectParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes import convex_parts, frame, mass, samples
from pipeline.stages.seeds import item_generator

SMALLEST_MARGIN = 0.002  # m, of the support polygon around the centre of mass
SMALLEST_TIP_ANGLE = np.radians(5.0)
CPU_SECONDS, MEGABYTES = 90, 8000  # that everything but the convex parts may take


def _stands(standing: resting.Stance) -> bool:
    return standing.margin >= SMALLEST_MARGIN and standing.tip_angle >= SMALLEST_TIP_ANGLE


def _union_volume(parts: list[convex_parts.Mesh]) -> float:
    """Volume of the union of convex parts, m3."""
    solids = [manifold3d.Manifold.hull_points(vertices) for vertices, _ in parts]
    return float(manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).volume())


def _falls_over(name: str, up: str, standing: resting.Stance, solid: repair.Solid) -> UserError:
    """Return the refusal of an object that does not stand, with what would help."""
    others = [
        axis
        for axis in frame.ROTATIONS
        if _stands(resting.stance(frame.canonical_vertices(solid.vertices, solid.faces, axis)))
    ]
    advice = f"set `up` to {' or '.join(others)}" if others else "give it a flat base or turn the mesh"
    return UserError(
        f"{name}: the object does not stand with {up} up (its centre of mass is "
        f"{1000 * standing.margin:.1f} mm inside its support, {1000 * SMALLEST_MARGIN:g} are needed); {advice}."
    )


@dataclass(frozen=True)
class _Shape:
    """The solid of an object in its own frame, and what is sampled from it."""

    solid: repair.Solid
    up: str
    vertices: NDArray[np.float64]
    standing: resting.Stance
    grid: resolution.Resolved
    changed: change.Change
    surface: NDArray[np.float32]


def _stood(
    name: str, solid: repair.Solid, up: str, turn: float | None, must_stand: bool
) -> tuple[NDArray[np.float64], resting.Stance]:
    """Return the vertices in the object's frame and how it stands.

    Raises:
        UserError: it does not stand, although it must.
    """
    vertices = frame.canonical_vertices(solid.vertices, solid.faces, up, turn)
    standing = resting.stance(vertices)
    if must_stand and not _stands(standing):
        raise _falls_over(name, up, standing, solid)
    return vertices, standing


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
    shape: ObjectParameters | MeshParameters,
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
    if isinstance(shape, MeshParameters):
        wishes, accept = repair.Wishes(shape.bodies, shape.wall), shape.accept_repair
    solid, changed = _repaired(name, raw, wishes, accept)
    vertices, standing = _stood(name, solid, up, shape.turn, must_stand)
    grid = resolution.resolved(vertices, solid.faces, parameters)
    if grid.passes_through_itself:
        solid, changed = _repaired(name, raw, replace(wishes, rebuild=True), accept)
        vertices, standing = _stood(name, solid, up, shape.turn, must_stand)
        grid = resolution.resolved(vertices, solid.faces, parameters)
    if not accept:
        resolution.check(grid, name)
    # Seeded by the name alone: another run seed must not change what the objects are.
    surface = samples.surface_samples(
        vertices, solid.faces, parameters.surface_points, item_generator(0, "prepare", name)
    )
    return _Shape(solid, up, vertices, standing, grid, changed, surface)


def prepare_object(
    name: str,
    shape: ObjectParameters | MeshParameters,
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
    if made.changed.notable:
        found["changes"] = made.changed.record()
    return found
