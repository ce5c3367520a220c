"""The whole preparation of one object, from raw triangles to the record that other stages load."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np

from pipeline.prepare import repair, resting, sources
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.objects import MeshParameters, ObjectParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes import convex_parts, distance_grid, frame, mass, samples
from pipeline.stages.seeds import item_generator

SMALLEST_MARGIN = 0.002  # m, of the support polygon around the centre of mass
SMALLEST_TIP_ANGLE = np.radians(5.0)


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


def prepare_object(
    name: str,
    shape: ObjectParameters | MeshParameters,
    parameters: PrepareParameters,
    raw: sources.RawMesh | None = None,
    must_stand: bool = True,
) -> PreparedObject:
    """Return the prepared object.

    Args:
        raw: its triangles, where they have been read already.
        must_stand: refuse an object that does not stand with its ``up`` axis upward.

    Raises:
        UserError: the source is missing or cannot become one solid that stands with its ``up`` axis upward.
    """
    raw = raw or sources.raw_mesh(shape, name)
    solid = repair.repair(raw.vertices, raw.faces, name)
    faces = solid.faces
    vertices = frame.canonical_vertices(solid.vertices, faces, shape.up, shape.turn)
    standing = resting.stance(vertices)
    if must_stand and not _stands(standing):
        raise _falls_over(name, shape.up, standing, solid)
    volume, _, inertia = mass.solid_properties(vertices, faces)
    parts, lost = convex_parts.convex_parts(vertices, faces, parameters)
    parts_volume = _union_volume(parts)
    grid = distance_grid.distance_grid(vertices, faces, parameters.distance_cells, parameters.distance_padding)
    # Seeded by the name alone: another run seed must not change what the objects are.
    surface = samples.surface_samples(vertices, faces, parameters.surface_points, item_generator(0, "prepare", name))
    hull_volume = mass.solid_properties(*convex_parts.convex_hull(vertices))[0]
    guessed: dict[str, Any] = {"guessed_unit": raw.guessed_unit, "longest_extent_in_file": raw.longest}
    return PreparedObject(
        name=name,
        vertices=vertices,
        faces=faces,
        parts=tuple(parts),
        distance=grid.values,
        distance_origin=grid.origin,
        distance_spacing=grid.spacing,
        surface_points=surface[:, :3].astype(np.float64),
        surface_normals=surface[:, 3:].astype(np.float64),
        mass=volume * shape.density,
        inertia=inertia * shape.density,
        volume=volume,
        extents=np.ptp(vertices, axis=0),
        provenance=(guessed if raw.guessed_unit else {})
        | {
            "source": raw.source,
            "licence": raw.licence,
            "repairs": list(solid.repairs),
            "raw_faces": len(raw.faces),
            "faces": len(faces),
            "hull_volume": hull_volume,
            "parts_volume": parts_volume,
            "parts_lost_depth": lost,
            "density": shape.density,
            "stance_margin": standing.margin,
            "stance_tip_degrees": float(np.degrees(standing.tip_angle)),
            "stable_poses": resting.stable_poses(vertices),
        },
    )
