"""The page in the browser: a panel to choose what is shown, and the picture of it.

All browsers that look at one server see the same. What a choice means is decided in ``choice``, ``rows`` and ``facts``,
how it is drawn in ``picture`` and ``scenes``.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from pipeline.pictures.film import CAMERA_POSITION, CAMERA_TARGET
from pipeline.pictures.serving import check_host, start_server
from pipeline.records.errors import UserError
from pipeline.view import facts, rows, scenes
from pipeline.view.canvas import Canvas
from pipeline.view.choice import Choice, named, turned_to
from pipeline.view.drawing import Drawing, camera, picked
from pipeline.view.library import Library
from pipeline.view.panel import GRASPS, PREVIOUS, Panel, offer
from pipeline.view.picture import Style, picture
from pipeline.view.tables import OBJECTS, RECONSTRUCTIONS, TRIALS_VIEW

FIELD_OF_VIEW = 32.0  # degrees, vertical
USUAL_ASPECT = 1.4  # width over height of a canvas before it is known
REFRESH = 0.2  # s between looks whether to end
MOST_SENTENCES = 3


class Page:
    """Serves the page until it is closed."""

    def __init__(self, read_library: Callable[[], Library], host: str, port: int, start: str = "") -> None:
        """Begin to serve on the first free port from ``port`` on.

        Args:
            read_library: returns what is looked at, by params.yaml as it is then.
            start: name of the row to show first; '' for the objects.

        Raises:
            UserError: nothing can be served there, or there is no such row.
        """
        check_host(host)
        self._read_library = read_library
        self.library = read_library()
        self.choice = named(start, self.library.index) if start else turned_to(OBJECTS)
        self.chosen = pd.DataFrame()  # lines of the index that pass the filters
        self.drawing = Drawing()
        self.related_links: dict[str, str] = {}
        self._lock = threading.RLock()  # the server calls back in threads of its own
        self._framed: tuple[Any, ...] = ()
        self.server = start_server(host, port, "grasps")
        self.address = f"http://{host}:{self.server.get_port()}"
        self.server.scene.set_up_direction("+z")
        self.server.initial_camera.fov = float(np.radians(FIELD_OF_VIEW))
        self.canvas = Canvas(self.server.scene, self._click)
        self.panel = Panel(self.server.gui)
        self._connect()
        self.update()
        self.server.on_client_connect(self._aim_one)

    # Choosing ---------------------------------------------------------------------------------------------------

    def _connect(self) -> None:
        panel = self.panel
        self._on(panel.view, lambda: turned_to(panel.view.value))
        self._on(panel.arrangement, lambda: replace(self.choice, arrangement=panel.arrangement.value))
        for column, control in panel.filters.items():
            self._on(control, partial(self._filtered, column))
        for control in (panel.joints, *panel.layers.values()):
            self._on(control, lambda: self.choice)
        self._on(panel.moment, lambda: replace(self.choice, moment=panel.moment.options.index(panel.moment.value)))
        panel.arrows.on_click(
            lambda event: self.act(partial(self.stepped, -1 if event.target.value == PREVIOUS else 1))
        )
        panel.related.on_click(lambda event: self.go_to(self.related_links[event.target.value]))
        panel.form.on_submit(lambda _: self.go_to(panel.name.value))
        panel.reload.on_click(lambda _: self.act(self._read_again))

    def _on(self, control: Any, change: Callable[[], Choice]) -> None:
        """Carry out ``change`` when somebody (and not this program) changes a control."""
        control.on_update(lambda event: self.act(change) if event.client is not None else None)

    def act(self, change: Callable[[], Choice]) -> None:
        """Show the choice that ``change`` returns, or say why it cannot be made."""
        with self._lock:
            try:
                self.choice = change()
            except UserError as error:
                self.panel.say(str(error))
                return
            self.update()

    def go_to(self, text: str) -> None:
        """Show the row that ``text`` names, or say why not."""
        self.act(lambda: named(text, self.library.index))

    def stepped(self, by: int) -> Choice:
        """Return the choice of the next rows, or of those before."""
        return self.choice.stepped(by, len(self.chosen))

    def _filtered(self, column: str) -> Choice:
        return self.choice.filtered(column, self.panel.value_of(column))

    def _read_again(self) -> Choice:
        self.library = self._read_library()
        return self.choice

    # Showing ----------------------------------------------------------------------------------------------------

    def update(self) -> None:
        """Bring panel and picture in line with what is chosen."""
        with self._lock, self.server.atomic():
            index, sentences = self.library.index(self.choice.view)
            self.chosen = rows.selected(index, self.choice.filters)
            self.choice = self.choice.within(len(self.chosen))
            more = len(sentences) - MOST_SENTENCES
            said = "\n\n".join(sentences[:MOST_SENTENCES] + ([f"And {more} more are missing."] if more > 0 else []))
            self.panel.show_filters(self.choice, index)
            try:
                self.drawing = self._draw(rows.reason_colours(sorted(index["reason"].unique())))
            except UserError as error:
                said, self.drawing = str(error), Drawing()
                self.panel.text.content = ""
            self.panel.say(said)
            self.canvas.show(self.drawing)
            self._frame()

    def _draw(self, colours: dict[str, rows.Colour]) -> Drawing:
        count, choice, panel = len(self.chosen), self.choice, self.panel
        panel.show_controls(choice, count)
        if not count:
            left = any(choice.filters.values())
            panel.heading.content = "No row is left; choose other filters." if left else ""
            return Drawing()
        begin, end = rows.page_of(count, choice.place, choice.page_size)
        lines = [line for _, line in self.chosen.iloc[begin:end].iterrows()]
        full = [self.library.row(line) for line in lines]
        single = choice.arrangement == scenes.ONE
        if single:
            self._describe(lines[0], full[0])
        else:
            hint = "; click one to look at it alone" if choice.arrangement == scenes.SIDE_BY_SIDE else ""
            panel.heading.content = f"rows {begin + 1} to {end} of {count}{hint}"
        if choice.view in GRASPS:
            offer(panel.joints, _postures(full), panel.joints.value)
        tints = None if single else np.array([colours[line["reason"]] for line in lines])
        style = Style(tints, scenes.JOINTS[panel.joints.value], panel.chosen_layers())
        return picture(self.library, self.choice, lines, full, style)

    def _describe(self, line: pd.Series, row: dict[str, Any]) -> None:
        """Write outcome and figures of a single row, and what it leads to."""
        panel, view = self.panel, self.choice.view
        panel.heading.content = facts.heading(line, self.choice.place, len(self.chosen))
        if view == OBJECTS:
            panel.text.content = facts.object_facts(self.library.prepared(line["first"]))
        elif view == RECONSTRUCTIONS:
            panel.text.content = facts.reconstruction_facts(line["first"], self.library.metrics(line["source"]))
        elif view == TRIALS_VIEW:
            phases = list(row["snapshot_phases"])
            if not 0 <= self.choice.moment < len(phases):
                self.choice = replace(self.choice, moment=len(phases) - 1)
            panel.show_moments(phases, self.choice.moment)
            command = facts.replay_command(line["name"])
            again = f"\n\nTo run it again: `{command}`" if command else ""
            panel.text.content = facts.trial_facts(row, self.choice.moment) + again
        else:
            panel.text.content = facts.grasp_facts(row)
        self.related_links = facts.related(line, row)
        panel.show_related(self.related_links)

    # The camera -------------------------------------------------------------------------------------------------

    def _frame(self) -> None:
        """Point all cameras at the drawing where what is shown has changed, and not only which row of it."""
        filters = tuple(self.choice.filters.values()) if self.choice.arrangement != scenes.ONE else ()
        frame = (self.choice.view, self.choice.arrangement, filters)
        if (self.drawing.solids or self.drawing.scenery) and frame != self._framed:
            self._framed = frame
            for client in [None, *self.server.get_clients().values()]:
                self._aim_one(client)

    def _aim_one(self, client: Any) -> None:
        """Point the camera of one browser, or (None) of those that will come, at the whole drawing."""
        with self._lock:
            aspect = USUAL_ASPECT if client is None else float(client.camera.aspect)
            if self.choice.view == TRIALS_VIEW:
                position, target = np.array(CAMERA_POSITION), np.array(CAMERA_TARGET)
            else:
                side_by_side = self.choice.arrangement == scenes.SIDE_BY_SIDE
                front = side_by_side or self.choice.view in (OBJECTS, RECONSTRUCTIONS)
                position, target = camera(self.drawing, aspect, np.radians(FIELD_OF_VIEW), front)
            where: Any = self.server.initial_camera if client is None else client.camera
            where.position, where.look_at = position, target

    def _click(self, event: Any) -> None:
        with self._lock:
            choice, chosen = self.choice, picked(self.drawing, event.ray_origin, event.ray_direction)
            if chosen is None or choice.arrangement != scenes.SIDE_BY_SIDE:
                return
            place = rows.page_of(len(self.chosen), choice.place, choice.page_size)[0] + chosen
            self.act(lambda: replace(choice, place=place, arrangement=scenes.ONE))

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
        """Stop serving."""
        self.server.stop()


def _postures(full: Sequence[dict[str, Any]]) -> list[str]:
    found = {name for row in full for name in scenes.postures(row)}
    return [name for name in scenes.JOINTS if name in found]
