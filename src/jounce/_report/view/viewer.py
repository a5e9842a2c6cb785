"""The live view: a server on this machine that shows a robot, what its controls do, and a player of the motion."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._report.single_screws import from_single_screws, to_single_screws
from jounce._report.view.controls import curves_of, escape_html, joint_sliders, legend_of, series_of, table_of
from jounce._report.view.scene import Scene, draw_scene, show
from jounce._report.view.server import HOST, serve
from jounce._report.view.track import ShownState, Track, rest_state
from jounce.core.errors import JounceError
from jounce.engine.engine import Engine
from jounce.model.positions import starting_position

if TYPE_CHECKING:
    import viser

CURVE_UPDATE_PERIOD = 0.2  # s: curves are sent as a whole, which takes longer than poses


@dataclass(eq=False)
class Viewer:
    """A robot that is served; what changes is the time, and whether it runs."""

    server: "viser.ViserServer"
    scene: Scene
    along: Track | None
    joints: list[Any]  # the sliders
    time: Any  # slider, or None without a motion
    table: Any
    plot: Any
    playing: Any  # checkbox, or None
    speed: Any
    busy: RLock = field(default_factory=RLock)
    setting: bool = False  # whether sliders are set from here, and not by the user
    drawn: float = -np.inf  # when the curves were drawn last
    positions: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of all joints, as they are shown

    @property
    def base(self) -> np.ndarray:
        """The pose of the base of the robot at rest: that at the time of the slider."""
        return np.eye(4) if self.along is None else self.along.at(self.time.value).C

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{HOST}:{self.server.get_port()}"

    def rest(self) -> None:
        """Show the robot at rest where the sliders of the joints are."""
        with self.busy:
            if not self.setting:
                if self.playing is not None:
                    self.playing.value = False
                q = from_single_screws(self.scene.robot.mechanism, np.array([slider.value for slider in self.joints]))
                try:
                    self._show(rest_state(self.scene.robot, q, self.base, self.positions))
                except JounceError as error:  # where loops cannot be closed, or contacts do not balance the robot
                    m = self.scene.robot.mechanism
                    if m.is_closed:
                        self._set(self.positions[list(m.independent_places)])
                    self.table.content = escape_html(str(error))

    def move(self) -> None:
        """Show the motion at the time of its slider."""
        with self.busy:
            assert self.along is not None
            now = self.along.at(self.time.value)
            self._set(to_single_screws(self.scene.robot.mechanism, now.q))
            self._show(now)

    def _set(self, q: np.ndarray) -> None:
        """Put the sliders of the joints at q."""
        self.setting = True
        for slider, x in zip(self.joints, q, strict=True):
            slider.value = float(x)
        self.setting = False

    def tick(self, seconds: float, clock: float) -> None:
        """Let the motion run on for some time, from its start again after its end; the clock is that of the curves."""
        if self.along is None:
            return
        if self.playing.value:
            first, last = self.along.t[[0, -1]]
            at = self.time.value + seconds * self.speed.value
            self.time.value = float(at if at <= last else first)
        if clock - self.drawn > CURVE_UPDATE_PERIOD:
            self.drawn = clock
            data = curves_of(self.along, self.time.value)
            if any(not np.array_equal(a, b) for a, b in zip(data, self.plot.data, strict=True)):
                self.plot.data = data

    def _show(self, now: ShownState) -> None:
        self.positions = now.positions
        with self.server.atomic():
            show(self.scene, now)
            self.table.content = table_of(self.scene.robot, now)


@contextmanager
def serve_robot(
    robot: Engine, file: Path, along: Track | None, port: int | None = None, folders: Sequence[Path] = ()
) -> Iterator[Viewer]:
    """Serve a robot in this context, along a motion or none; its file and meshes in folders show its shapes."""
    with serve(port) as server:
        yield _fill(server, robot, file, along, folders)


def _fill(
    server: "viser.ViserServer", robot: Engine, file: Path, along: Track | None, folders: Sequence[Path]
) -> Viewer:
    scene, gui = draw_scene(server, robot, file, along, folders), server.gui
    server.initial_camera.position = tuple(scene.size * np.array([1.3, -1.3, 1.0]))
    server.initial_camera.look_at = (0.0, 0.0, 0.35 * scene.size)
    gui.add_html(f"<b>{escape_html(robot.name)}</b>")
    time = plot = playing = speed = None
    if along is not None:
        with gui.add_folder("Motion"):
            first, last = map(float, along.t[[0, -1]])
            time = gui.add_slider("t [s]", first, last, max((last - first) / 1e4, 1e-6), first)
            playing = gui.add_checkbox("play", False)
            speed = gui.add_slider("speed", 0.05, 2.0, 0.05, 1.0)
            plot = gui.add_uplot(curves_of(along, first), series_of(robot), title="Q [N m or N]", aspect=1.4)
    with gui.add_folder("Joints"):
        joints = joint_sliders(gui, robot, along)
    with gui.add_folder("Q"):
        table = gui.add_html("")
    with gui.add_folder("Show"):
        frames = gui.add_checkbox("frames", False)
        arrows = gui.add_checkbox("wrenches", True)
        gui.add_html(legend_of(scene))
    viewer = Viewer(
        server, scene, along, joints, time, table, plot, playing, speed, positions=starting_position(robot.mechanism)
    )
    for slider in joints:
        slider.on_update(lambda _: viewer.rest())
    if time is not None:
        time.on_update(lambda _: viewer.move())
    frames.on_update(lambda _: _set_visible(scene.frames, frames.value))
    arrows.on_update(lambda _: _set_visible(scene.arrows.values(), arrows.value))
    (viewer.move if along is not None else viewer.rest)()
    return viewer


def _set_visible(handles: Any, visible: bool) -> None:
    for handle in handles:
        handle.visible = visible


def run(viewer: Viewer, stopped: Callable[[float], bool]) -> None:
    """Play until `stopped`, which waits for some seconds, returns True."""
    from time import monotonic

    before = monotonic()
    while not stopped(1 / 30):
        now = monotonic()
        viewer.tick(now - before, now)
        before = now
