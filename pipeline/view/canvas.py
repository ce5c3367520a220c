"""The browser's scene, kept in line with a drawing: what has not changed is not sent again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.pictures.decimation import Mesh
from pipeline.pictures.render import corner_normals
from pipeline.records.poses import position_quaternion
from pipeline.view.drawing import Cloud, Drawing, Lines, Solid


class Canvas:
    """What all browsers show."""

    def __init__(self, scene: Any, clicked: Callable[[Any], None]) -> None:
        """Draw on a scene of viser.

        Args:
            clicked: what to do with clicks on solids.
        """
        self._scene, self._clicked = scene, clicked
        self.shown: dict[str, tuple[Any, Any]] = {}  # key to what was drawn and its handle

    def show(self, drawing: Drawing) -> None:
        """Bring the scene in line with a drawing."""
        wanted: dict[str, Any] = {f"/solid/{one.key}": one for one in [*drawing.solids, *drawing.scenery]}
        wanted |= {f"/cloud/{one.key}": one for one in drawing.clouds}
        wanted |= {f"/lines/{one.key}": one for one in drawing.lines}
        wanted |= {f"/label/{number:03d}": one for number, one in enumerate(drawing.labels)}
        for name in set(self.shown) - set(wanted):
            self.shown.pop(name)[1].remove()
        for name, one in wanted.items():
            before, handle = self.shown.get(name, (None, None))
            if isinstance(one, Solid) and isinstance(before, Solid) and _same_mesh(before, one):
                handle.batched_positions, handle.batched_wxyzs = _poses(one)
                handle.batched_colors = _linear(one.colours)
                handle.opacity = _opacity(one)
            else:
                handle = _add(self._scene, name, one)
                if isinstance(one, Solid):
                    handle.on_click(self._clicked)
            self.shown[name] = (one, handle)


def _same_mesh(before: Solid, now: Solid) -> bool:
    """Say whether the browser can keep a mesh: the same arrays, as often."""
    same_arrays = before.vertices is now.vertices and before.faces is now.faces
    return len(before.T_world) == len(now.T_world) and (
        same_arrays or (np.array_equal(before.vertices, now.vertices) and np.array_equal(before.faces, now.faces))
    )


def _bytes(colours: Any) -> Any:
    return np.round(255 * np.asarray(colours)).astype(np.uint8)


def _linear(colours: Any) -> Any:
    """The browser takes colours of repeated meshes and of lines as linear light, unlike those of points."""
    return _bytes(np.asarray(colours) ** 2.2)


def _poses(solid: Solid) -> tuple[Any, Any]:
    positions, quaternions = position_quaternion(solid.T_world)
    return positions.astype(np.float32), quaternions.astype(np.float32)


def _opacity(solid: Solid) -> float | None:
    return None if solid.opacity == 1 else solid.opacity


def _add(scene: Any, name: str, one: Any) -> Any:
    if isinstance(one, Solid):
        vertices, faces = _with_edges((one.vertices, one.faces))
        positions, quaternions = _poses(one)
        return scene.add_batched_meshes_simple(
            name,
            vertices,
            faces,
            quaternions,
            positions,
            batched_colors=_linear(one.colours),
            opacity=_opacity(one),
            lod="off",
            side="double",
        )
    if isinstance(one, Cloud):
        return scene.add_point_cloud(
            name, one.points, _bytes(one.colours), point_size=one.size, point_shape="circle", precision="float32"
        )
    if isinstance(one, Lines):
        colours = np.repeat(_linear(one.colours)[:, None], 2, axis=1)
        return scene.add_line_segments(name, one.ends, colours, thickness=2.5, thickness_units="screen")
    text, place = one
    return scene.add_label(name, text, position=place, anchor="top-center", font_screen_scale=0.8)


def _with_edges(mesh: Mesh) -> tuple[Any, Any]:
    """Double vertices along edges: the browser shades smoothly across what shares a vertex."""
    vertices, faces = mesh
    corners = np.concatenate([vertices[faces], np.round(corner_normals(vertices, faces), 3)], axis=2).reshape(-1, 6)
    distinct, place = np.unique(corners, axis=0, return_inverse=True)
    return distinct[:, :3].astype(np.float32), place.reshape(-1, 3).astype(np.uint32)
