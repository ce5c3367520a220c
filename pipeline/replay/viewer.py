"""A recording in a browser: a scene to turn and zoom, with a slider over time."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.pictures.appearance import Appearance, appearance, moving_poses
from pipeline.pictures.film import CAMERA_DEGREES, CAMERA_POSITION, CAMERA_TARGET
from pipeline.pictures.render import Body, corner_normals
from pipeline.pictures.serving import check_host, start_server
from pipeline.records.poses import position_quaternion
from pipeline.records.recordings import Recording

REFRESH = 0.04  # s between updates while playing
SPEEDS = ("0.25", "0.5", "1", "2", "4")
PLAY, PAUSE = "Play", "Pause"


class Viewer:
    """Serves one recording until it is closed."""

    def __init__(self, recording: Recording, hand: Hand, host: str, port: int) -> None:
        """Begin to serve ``recording`` on the first free port from ``port`` on.

        Raises:
            UserError: nothing can be served there, or an object's mesh is missing.
        """
        check_host(host)
        looks = appearance(recording, hand)
        self.recording, self.hand = recording, hand
        self.playing = True
        self.one_at_a_time = threading.RLock()  # the page speaks in threads of its own
        self.server = start_server(host, port, recording.about.name)
        self.address = f"http://{host}:{self.server.get_port()}"
        self._add_scene(looks)
        self._add_controls()
        self.show(recording.time[0])

    def _add_scene(self, looks: Appearance) -> None:
        scene = self.server.scene
        scene.set_up_direction("+z")
        self.server.initial_camera.fov = float(np.radians(CAMERA_DEGREES + 6.0))  # the panel covers a part
        self.server.initial_camera.position = CAMERA_POSITION
        self.server.initial_camera.look_at = CAMERA_TARGET
        for name, body in (("/sponge", looks.sponge), ("/table", looks.table)):
            _place(_add_mesh(scene, name, body), body.T_world)
        names = [f"/robot/{index:02d}" for index in range(len(looks.robot))]
        names += [f"/object{index}/{name}" for index, name in enumerate(self.recording.about.objects)]
        self.handles = [_add_mesh(scene, name, body) for name, body in zip(names, looks.moving, strict=True)]

    def _add_controls(self) -> None:
        recording = self.recording
        gui: Any = self.server.gui  # its types hide that values can be set
        first, last = float(recording.time[0]), float(recording.time[-1])
        starts = {name: float(recording.time[recording.phase.index(name)]) for name in dict.fromkeys(recording.phase)}
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.add_markdown(f"**{recording.about.name}**: {recording.about.outcome}")
        self.phase = gui.add_dropdown("phase", tuple(starts), initial_value=recording.phase[0])
        self.slider = gui.add_slider("time (s)", 0.0, last, 0.01, first)
        self.button = gui.add_button(PAUSE)
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")

        @self.slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # by hand; playing moves it too
                self.play(False)
                self.show(self.slider.value)

        @self.button.on_click
        def _(_: Any) -> None:
            if not self.playing and self.slider.value >= last:
                self.slider.value = first
            self.play(not self.playing)

        @self.phase.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.show(starts[self.phase.value])

    def play(self, on: bool) -> None:
        """Begin or stop to play."""
        self.playing = on
        self.button.label = PAUSE if on else PLAY

    def show(self, seconds: float) -> None:
        """Show the last moment that is not after ``seconds``."""
        time_ = self.recording.time
        moment = int(np.clip(np.searchsorted(time_, seconds + 1e-9, side="right") - 1, 0, len(time_) - 1))
        with self.one_at_a_time, self.server.atomic():
            for handle, T in zip(self.handles, moving_poses(self.recording, self.hand, moment), strict=True):
                _place(handle, T)
            self.phase.value = self.recording.phase[moment]
            self.slider.value = float(seconds)

    def run(self) -> None:
        """Play until interrupted; then close."""
        last = float(self.recording.time[-1])
        try:
            before = time.monotonic()
            while True:
                time.sleep(REFRESH)
                now = time.monotonic()
                if self.playing:
                    self.show(min(self.slider.value + (now - before) * float(self.speed.value), last))
                    if self.slider.value >= last:
                        self.play(False)
                before = now
        except KeyboardInterrupt:
            pass
        finally:
            self.close()

    def close(self) -> None:
        """Stop to serve."""
        self.server.stop()


def _add_mesh(scene: Any, name: str, body: Body) -> Any:
    """Add a mesh, with vertices doubled along edges: the browser shades smoothly across what shares a vertex."""
    normals = body.normals if body.normals is not None else corner_normals(body.vertices, body.faces)
    corners = np.concatenate([body.vertices[body.faces], np.round(normals, 3)], axis=2).reshape(-1, 6)
    distinct, place = np.unique(corners, axis=0, return_inverse=True)
    vertices, faces = distinct[:, :3].astype(np.float32), place.reshape(-1, 3).astype(np.uint32)
    colour = tuple(round(255 * channel) for channel in body.colour)
    return scene.add_mesh_simple(name, vertices, faces, color=colour, side="double")


def _place(handle: Any, T: NDArray[np.float64]) -> None:
    handle.position, handle.wxyz = position_quaternion(T)
