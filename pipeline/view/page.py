"""The page in the browser: a panel to choose what is shown, and the picture of it.

All browsers that look at one server see the same. What a choice means is decided in ``rows``, ``scenes`` and ``facts``.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.hand.model import load_hand
from pipeline.pictures.decimation import Mesh
from pipeline.pictures.render import corner_normals
from pipeline.pictures.serving import check_host, start_server
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.poses import inverse_pose, position_quaternion, transform_points
from pipeline.view import facts, rows, scenes
from pipeline.view.drawing import Cloud, Drawing, Lines, Solid, camera, picked
from pipeline.view.library import Library
from pipeline.view.tables import (
    CANDIDATES_VIEW,
    MERGED_VIEW,
    OBJECTS,
    RECONSTRUCTIONS,
    TRIALS_VIEW,
    VALIDATED_VIEW,
    VIEWS,
    sponge_height,
)

FIELD_OF_VIEW = 32.0  # degrees, vertical
USUAL_ASPECT = 1.4  # width over height of a canvas before it is known
REFRESH = 0.2  # s between looks whether to end
MOST_SIDE_BY_SIDE, MOST_ON_TOP = 48, 500  # at once; the arrows lead to the next
MOST_SENTENCES = 3
ALL = "all"
LABELS = {
    "source": {MERGED_VIEW: "made by", TRIALS_VIEW: "grasps", RECONSTRUCTIONS: "capture"},
    "style": {CANDIDATES_VIEW: "style", VALIDATED_VIEW: "style"},
    "first": {
        CANDIDATES_VIEW: "object",
        VALIDATED_VIEW: "object",
        MERGED_VIEW: "first object",
        TRIALS_VIEW: "first object",
    },
    "second": {MERGED_VIEW: "second object", TRIALS_VIEW: "second object"},
    "fate": {
        CANDIDATES_VIEW: "fate",
        VALIDATED_VIEW: "fate",
        MERGED_VIEW: "fate",
        TRIALS_VIEW: "reason",
    },
    "outcome": dict.fromkeys((CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW, TRIALS_VIEW), "outcome"),
}
ARRANGEMENTS = {
    OBJECTS: (scenes.SIDE_BY_SIDE, scenes.ONE),
    CANDIDATES_VIEW: (scenes.SIDE_BY_SIDE, scenes.ONE, scenes.ON_TOP),
    VALIDATED_VIEW: (scenes.SIDE_BY_SIDE, scenes.ONE, scenes.ON_TOP),
    MERGED_VIEW: (scenes.SIDE_BY_SIDE, scenes.ONE, scenes.ON_TOP),
    TRIALS_VIEW: (scenes.ONE,),
    RECONSTRUCTIONS: (scenes.SIDE_BY_SIDE, scenes.ONE),
}
# Layers of a single row, by view.
LAYERS = {
    "contacts": (CANDIDATES_VIEW, VALIDATED_VIEW),
    "samples": (CANDIDATES_VIEW, VALIDATED_VIEW),
    "parts": (CANDIDATES_VIEW, VALIDATED_VIEW),
    "hand_candidates": (CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW),
    "see_through": (CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW),
}
LAYER_LABELS = {
    "contacts": "contacts",
    "samples": "surface samples",
    "parts": "convex parts",
    "hand_candidates": "hand's candidates",
    "see_through": "see through",
}


class Page:
    """Serves the page until it is closed."""

    def __init__(self, library: Library, host: str, port: int, start: str = "") -> None:
        """Begin to serve on the first free port from ``port`` on.

        Args:
            start: name of the row to show first; '' for the objects.

        Raises:
            UserError: nothing can be served there, or there is no such row.
        """
        check_host(host)
        self.library = library
        self.view = OBJECTS
        self.filters = dict.fromkeys(rows.FILTERS, rows.ANY)
        self.arrangement = scenes.SIDE_BY_SIDE
        self.place = 0  # of the row among those selected
        self.moment = -1  # of a trial: which snapshot
        self.drawing = Drawing()
        self._lock = threading.RLock()  # the page speaks in threads of its own
        self._shown: dict[str, tuple[Any, Any]] = {}  # what the browser has: key to (what was drawn, handle)
        self._framed: tuple[Any, ...] = ()
        if start:
            self._choose(start)
        self.server = start_server(host, port, "grasps")
        self.address = f"http://{host}:{self.server.get_port()}"
        self.server.scene.set_up_direction("+z")
        self.server.initial_camera.fov = float(np.radians(FIELD_OF_VIEW))
        self._add_controls()
        self.update()
        self.server.on_client_connect(self._aim_one)

    # Choosing ---------------------------------------------------------------------------------------------------

    def _choose(self, text: str) -> None:
        """Turn to the row that ``text`` names, among those of its table; to many at once where it names a table."""
        name = rows.tidy_name(text)
        view = rows.view_of(name)
        index, sentences = self.library.index(view)
        if index.empty and sentences:
            raise UserError(sentences[0])
        row = rows.find(index, name)
        line = index[index["name"] == row].iloc[0]
        self.view, self.filters = view, dict.fromkeys(rows.FILTERS, rows.ANY)
        if view not in (OBJECTS, RECONSTRUCTIONS):
            self.filters |= {column: line[column] for column in ("source", "style", "first", "second")}
        chosen = rows.selected(index, self.filters)
        self.place = chosen["name"].tolist().index(line["name"])
        self.arrangement, self.moment = scenes.ONE if row == name else ARRANGEMENTS[view][0], -1

    def go_to(self, text: str) -> None:
        """Show the row that ``text`` names, or say why not."""
        with self._lock:
            try:
                self._choose(text)
            except UserError as error:
                self._say(str(error))
                return
            self.update()

    def _turn_to(self, view: str) -> None:
        self.view, self.place, self.moment = view, 0, -1
        self.filters = dict.fromkeys(rows.FILTERS, rows.ANY)
        self.arrangement = ARRANGEMENTS[view][0]

    def _step(self, by: int) -> None:
        size = {scenes.SIDE_BY_SIDE: MOST_SIDE_BY_SIDE, scenes.ON_TOP: MOST_ON_TOP}.get(self.arrangement, 1)
        count = max(len(self.chosen), 1)
        if size == 1:
            self.place = (self.place + by) % count
        else:
            pages = -(-count // size)
            self.place = (self.place // size + by) % pages * size

    # The panel --------------------------------------------------------------------------------------------------

    def _add_controls(self) -> None:
        gui: Any = self.server.gui  # its types hide that values can be set
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        gui.main_panel.dock_right()
        gui.set_panel_label("What the pipeline made")
        self.notice = gui.add_markdown("", visible=False)
        self.view_choice = gui.add_dropdown("show", VIEWS, initial_value=self.view)
        self.arrangement_choice = gui.add_dropdown("arranged", ARRANGEMENTS[OBJECTS])
        self.filter_choices = {column: gui.add_dropdown(column, (ALL,)) for column in rows.FILTERS}
        self.legend = gui.add_html("")
        self.heading = gui.add_markdown("")
        self.arrows = gui.add_button_group("row", ("◀ previous", "next ▶"))
        self.moment_choice = gui.add_dropdown("moment", ("",))
        self.joints_choice = gui.add_dropdown("joints", ("grasp",))
        self.text = gui.add_markdown("")
        self.related_links: dict[str, str] = {}
        self.related_choice = gui.add_button_group("see also", ("object",))
        self.layers = gui.add_folder("Layers")
        with self.layers:
            self.layer_choices = {
                name: gui.add_checkbox(LAYER_LABELS[name], getattr(scenes.STANDARD, name)) for name in LAYERS
            }
        with gui.add_form(None) as form:
            self.name_choice = gui.add_text("go to", "", hint=f"a row's name, such as {rows.EXAMPLE}")
        self.reload = gui.add_button("Read again", hint="after dvc repro, or a change of params.yaml")

        self._on(self.view_choice, lambda: self._turn_to(self.view_choice.value))
        self._on(self.arrangement_choice, lambda: setattr(self, "arrangement", self.arrangement_choice.value))
        for column, choice in self.filter_choices.items():
            self._on(choice, partial(self._take_filter, column))
        for choice in (self.joints_choice, *self.layer_choices.values()):
            self._on(choice, lambda: None)
        self._on(self.moment_choice, self._take_moment)
        self.arrows.on_click(lambda event: self._act(lambda: self._step(-1 if "◀" in event.target.value else 1)))
        self.related_choice.on_click(lambda event: self.go_to(self.related_links[event.target.value]))
        form.on_submit(lambda _: self.go_to(self.name_choice.value))
        self.reload.on_click(lambda _: self._act(self._read_again))

    def _on(self, choice: Any, change: Callable[[], None]) -> None:
        """Carry out ``change`` and draw anew when somebody (and not this program) changes a control."""
        choice.on_update(lambda event: self._act(change) if event.client is not None else None)

    def _act(self, change: Callable[[], None]) -> None:
        with self._lock:
            try:
                change()
            except UserError as error:
                self._say(str(error))
                return
            self.update()

    def _filter(self, column: str, text: str) -> None:
        self.filters[column] = rows.ANY if text.startswith(f"{ALL} (") else text.rpartition(" (")[0]
        self.place = 0

    def _take_filter(self, column: str) -> None:
        self._filter(column, self.filter_choices[column].value)

    def _take_moment(self) -> None:
        self.moment = self.moment_choice.options.index(self.moment_choice.value)

    def _read_again(self) -> None:
        from pipeline.records.parameters import read_parameters

        self.library = Library(read_parameters())

    def _say(self, sentence: str) -> None:
        self.notice.content, self.notice.visible = sentence, bool(sentence)

    # Showing ----------------------------------------------------------------------------------------------------

    def update(self) -> None:
        """Bring panel and picture in line with what is chosen."""
        with self._lock, self.server.atomic():
            index, sentences = self.library.index(self.view)
            self.chosen = rows.selected(index, self.filters)
            self.place = min(max(self.place, 0), max(len(self.chosen) - 1, 0))
            if self.arrangement not in ARRANGEMENTS[self.view]:
                self.arrangement = ARRANGEMENTS[self.view][0]
            more = len(sentences) - MOST_SENTENCES
            said = "\n\n".join(sentences[:MOST_SENTENCES] + ([f"And {more} more are missing."] if more > 0 else []))
            self._update_filters(index)
            try:
                self.drawing = self._draw(rows.fate_colours(sorted(index["fate"].unique())))
            except UserError as error:
                said, self.drawing = str(error), Drawing()
                self.text.content = ""
            self._say(said)
            self._send()

    def _update_filters(self, index: pd.DataFrame) -> None:
        self.view_choice.value = self.view
        _offer(self.arrangement_choice, ARRANGEMENTS[self.view], self.arrangement)
        for column, choice in self.filter_choices.items():
            label = LABELS[column].get(self.view, "")
            choice.visible = bool(label) and not index.empty
            counts = rows.choices(index, self.filters, column)
            if label:
                choice.label = label
            options = {rows.ANY: f"{ALL} ({sum(counts.values())})"}
            options |= {value: f"{value} ({count})" for value, count in counts.items()}
            _offer(choice, tuple(options.values()), options[self.filters[column]])
        colours = rows.fate_colours(sorted(index["fate"].unique()))
        self.legend.content = facts.legend(rows.counted(self.chosen), colours)

    def _draw(self, colours: dict[str, rows.Colour]) -> Drawing:
        count = len(self.chosen)
        for name, views in LAYERS.items():
            single = self.arrangement == scenes.ONE or name == "see_through"
            self.layer_choices[name].visible = count > 0 and single and self.view in views
        grasps = self.view in (CANDIDATES_VIEW, VALIDATED_VIEW, MERGED_VIEW)
        self.layers.visible = count > 0 and grasps
        self.arrows.visible, self.joints_choice.visible = count > 0, count > 0 and grasps
        self.moment_choice.visible = self.related_choice.visible = False
        self.heading.content = self.text.content = ""
        if not count:
            self.heading.content = "No row is left; choose other filters." if any(self.filters.values()) else ""
            return Drawing()
        size = {scenes.SIDE_BY_SIDE: MOST_SIDE_BY_SIDE, scenes.ON_TOP: MOST_ON_TOP}.get(self.arrangement, 1)
        begin, end = rows.page_of(count, self.place, size)
        lines = [line for _, line in self.chosen.iloc[begin:end].iterrows()]
        full = [self.library.row(line) for line in lines]
        tints = np.array([colours[line["fate"]] for line in lines]) if self.arrangement != scenes.ONE else None
        if self.arrangement == scenes.ONE:
            self._tell(lines[0], full[0])
        else:
            hint = "; click one to look at it alone" if self.arrangement == scenes.SIDE_BY_SIDE else ""
            self.heading.content = f"rows {begin + 1} to {end} of {count}{hint}"
        return self._picture(lines, full, tints)

    def _picture(self, lines: list[pd.Series], full: list[dict[str, Any]], tints: Any) -> Drawing:
        library = self.library
        layers = scenes.Layers(**{name: bool(choice.value) for name, choice in self.layer_choices.items()})
        names = {line[column] for line in lines for column in ("first", "second")} - {""}
        if self.view == OBJECTS:
            return scenes.objects_in_parts([library.prepared(line["first"]) for line in lines])
        if self.view == RECONSTRUCTIONS:
            return scenes.reconstructions([self._photographed(line["source"], line["first"]) for line in lines])
        if self.view == TRIALS_VIEW:
            first, second = (library.prepared(lines[0][column]) for column in ("first", "second"))
            height = sponge_height(library.parameters, lines[0]["source"])
            return scenes.trial_moment(full[0], (first, second), height, self.moment)
        _offer(self.joints_choice, tuple(self._postures(full)), self.joints_choice.value)
        joints = scenes.JOINTS[self.joints_choice.value]
        if self.view == MERGED_VIEW:
            return self._merged(lines, full, tints, joints, layers)
        objects = {name: library.prepared(name) for name in names}
        hand = load_hand(library.parameters.hand)
        return scenes.grasps_on_objects(full, objects, tints, self.arrangement, joints, layers, hand)

    def _postures(self, full: list[dict[str, Any]]) -> list[str]:
        found = {name for row in full for name in scenes.postures(row)}
        return [name for name in scenes.JOINTS if name in found]

    def _merged(
        self, lines: list[pd.Series], full: list[dict[str, Any]], tints: Any, joints: str, layers: scenes.Layers
    ) -> Drawing:
        """Grasps of reconstructed objects are drawn on the surfaces in whose frames they are given."""
        meshes: dict[str, Mesh] = {}
        renamed = []
        for line, row in zip(lines, full, strict=True):
            own = dict(row)
            for slot, column in enumerate(("first", "second")):
                name = line[column]
                if line["source"] == paths.RECONSTRUCTED:
                    capture = self.library.parameters.reconstructed[line["first"]].capture
                    item = self.library.reconstructed(capture, name)
                    name = f"{name} of {capture}"
                    meshes[name] = (item.vertices, item.faces)
                else:
                    prepared = self.library.prepared(name)
                    meshes[name] = (prepared.vertices, prepared.faces)
                own[f"object{slot}"] = name
            renamed.append(own)
        return scenes.merged_grasps(renamed, meshes, tints, self.arrangement, joints, layers)

    def _photographed(self, capture: str, name: str) -> Any:
        item, truth = self.library.reconstructed(capture, name), self.library.truth(capture, name)
        if truth is None:
            return item, None, None
        there = transform_points(inverse_pose(item.T_scene_object), truth[0])
        return item, truth, scenes.distance_to_mesh(item.points, (there, truth[1]))

    def _tell(self, line: pd.Series, row: dict[str, Any]) -> None:
        """Write what a single row says, and where it leads."""
        self.heading.content = facts.heading(line, self.place, len(self.chosen))
        if self.view == OBJECTS:
            self.text.content = facts.object_facts(self.library.prepared(line["first"]))
        elif self.view == RECONSTRUCTIONS:
            self.text.content = facts.reconstruction_facts(line["first"], self.library.metrics(line["source"]))
        elif self.view == TRIALS_VIEW:
            phases = [f"{number + 1}. {name}" for number, name in enumerate(row["snapshot_phases"])]
            if not 0 <= self.moment < len(phases):
                self.moment = len(phases) - 1
            if phases:
                self.moment_choice.visible = True
                _offer(self.moment_choice, tuple(phases), phases[self.moment])
            command = facts.replay_command(line["name"])
            again = f"\n\nTo run it again: `{command}`" if command else ""
            self.text.content = facts.trial_facts(row, self.moment) + again
        else:
            self.text.content = facts.grasp_facts(row)
        self.related_links = facts.related(line, row)
        if self.related_links:
            self.related_choice.visible = True
            self.related_choice.options = tuple(self.related_links)

    # Drawing ----------------------------------------------------------------------------------------------------

    def _send(self) -> None:
        """Bring the browser's scene in line with the drawing; what has not changed is not sent again."""
        drawing, scene = self.drawing, self.server.scene
        wanted: dict[str, Any] = {f"/solid/{one.key}": one for one in [*drawing.solids, *drawing.scenery]}
        wanted |= {f"/cloud/{one.key}": one for one in drawing.clouds}
        wanted |= {f"/lines/{one.key}": one for one in drawing.lines}
        wanted |= {f"/label/{number:03d}": one for number, one in enumerate(drawing.labels)}
        for name in set(self._shown) - set(wanted):
            self._shown.pop(name)[1].remove()
        for name, one in wanted.items():
            before, handle = self._shown.get(name, (None, None))
            if isinstance(one, Solid) and isinstance(before, Solid) and _same_mesh(before, one):
                handle.batched_positions, handle.batched_wxyzs = _poses(one)
                handle.batched_colors = _linear(one.colours)
                handle.opacity = None if one.opacity == 1 else one.opacity
            else:
                handle = _add(scene, name, one)
                if isinstance(one, Solid):
                    handle.on_click(self._click)
            self._shown[name] = (one, handle)
        frame = (self.view, self.arrangement, tuple(self.filters.values()) if self.arrangement != scenes.ONE else ())
        if (drawing.solids or drawing.scenery) and frame != self._framed:
            self._framed = frame
            self._aim()

    def _aim(self) -> None:
        """Point all cameras at the whole drawing."""
        for client in [None, *self.server.get_clients().values()]:
            self._aim_one(client)

    def _aim_one(self, client: Any) -> None:
        """Point the camera of one browser, or (None) of those that will come, at the whole drawing."""
        from pipeline.replay.video import CAMERA_POSITION, CAMERA_TARGET

        with self._lock:
            aspect = USUAL_ASPECT if client is None else float(client.camera.aspect)
            if self.view == TRIALS_VIEW:
                position, target = np.array(CAMERA_POSITION), np.array(CAMERA_TARGET)
            else:
                front = self.arrangement == scenes.SIDE_BY_SIDE or self.view in (OBJECTS, RECONSTRUCTIONS)
                position, target = camera(self.drawing, aspect, np.radians(FIELD_OF_VIEW), front)
            where: Any = self.server.initial_camera if client is None else client.camera
            where.position, where.look_at = position, target

    def _click(self, event: Any) -> None:
        with self._lock:
            chosen = picked(self.drawing, event.ray_origin, event.ray_direction)
            if chosen is None or self.arrangement != scenes.SIDE_BY_SIDE:
                return
            self.place = rows.page_of(len(self.chosen), self.place, MOST_SIDE_BY_SIDE)[0] + chosen
            self.arrangement = scenes.ONE
            self.update()

    def run(self) -> None:
        """Serve until interrupted; then close."""
        try:
            while True:
                time.sleep(REFRESH)
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """Stop to serve."""
        self.server.stop()


def _offer(choice: Any, options: tuple[str, ...], value: str) -> None:
    if tuple(choice.options) != options:
        choice.options = options
    if value in options:
        choice.value = value


def _same_mesh(before: Solid, now: Solid) -> bool:
    """Say whether the browser can keep a mesh: the same arrays, as often."""
    return (
        before.vertices is now.vertices and before.faces is now.faces and len(before.T_world) == len(now.T_world)
    ) or (
        len(before.T_world) == len(now.T_world)
        and np.array_equal(before.vertices, now.vertices)
        and np.array_equal(before.faces, now.faces)
    )


def _bytes(colours: Any) -> Any:
    return np.round(255 * np.asarray(colours)).astype(np.uint8)


def _linear(colours: Any) -> Any:
    """The browser takes colours of repeated meshes and of lines as linear light, unlike those of points."""
    return _bytes(np.asarray(colours) ** 2.2)


def _poses(solid: Solid) -> tuple[Any, Any]:
    positions, quaternions = position_quaternion(solid.T_world)
    return positions.astype(np.float32), quaternions.astype(np.float32)


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
            opacity=None if one.opacity == 1 else one.opacity,
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
