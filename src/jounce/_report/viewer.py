"""Serves the live view: a robot in a browser on this machine, by viser.

`serve_robot` is the door: it draws the scene, adds the controls, which are sliders of the joints, the values and curves
of Q, and words, and ties them to a `Viewer`; `run` plays the motion. The server is for browsers on this machine, for no
page but its own, and prints no word.
"""

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from importlib import import_module
from pathlib import Path
from threading import Lock, RLock
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np

from jounce._report.drawing import from_single_screws, to_single_screws
from jounce._report.panels import slider_ranges
from jounce._report.scene import Scene, ShownState, Track, draw_scene, rest_state, show
from jounce.core import errors
from jounce.core.errors import JounceError
from jounce.engine.engine import Engine
from jounce.figures import canvas
from jounce.model import coordinates, positions
from jounce.model.limits import derivative_unit

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
        server, scene, along, joints, time, table, plot, playing, speed, positions=positions.start(robot.mechanism)
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


# Controls.
VIEW_CURVE_POINTS = 400  # of a curve: it is sent again five times per second
TIME_MARK_WIDTH = 1e-4  # of the duration: how wide the mark of the time is


def joint_sliders(gui: Any, robot: Engine, along: Track | None) -> list[Any]:
    """A slider for each single screw: from limit to limit, and as far as the motion goes."""
    q = np.zeros((0, robot.n)) if along is None else to_single_screws(robot.mechanism, along.q.values)
    lowest, highest = slider_ranges(robot.mechanism, q)
    m = robot.mechanism
    rest = positions.start(m)[list(m.independent_places)] if m.is_closed else np.zeros(robot.n)
    starts = rest.clip(lowest, highest) if along is None else q[0]
    found = []
    columns = (robot.joint_names, coordinates.units(robot.mechanism), *(x.tolist() for x in (lowest, highest, starts)))
    for name, unit, lower, upper, start in zip(*columns, strict=True):
        label = f"{errors.escape_text(errors.shorten(name))} [{unit}]"
        found.append(gui.add_slider(label, lower, upper, max((upper - lower) / 2000, 1e-9), start))
    return found


def curves_of(along: Track, t: float) -> tuple[np.ndarray, ...]:
    """Times and Q of each joint as the plot takes them, and a curve that marks a time by a peak."""
    first, last = along.t[[0, -1]]
    width = TIME_MARK_WIDTH * (last - first)
    kept = np.unique(np.linspace(0, len(along.t) - 1, VIEW_CURVE_POINTS).astype(int))
    at = np.clip([t - width, t, t + width], first, last)
    times = np.unique([*along.t[kept], *at])
    Q = along.Q.values
    low, high = float(Q.min()), float(Q.max())
    mark = np.where(np.abs(times - t) < width / 2, high, low)
    return (times, *(np.interp(times, along.t, of_joint) for of_joint in Q.T), mark)


def series_of(robot: Engine) -> tuple[Any, ...]:
    """The looks of the curves of `curves_of`."""
    from viser import uplot

    joints = [
        uplot.Series(
            label=errors.escape_text(errors.shorten(name)), stroke=canvas.COLOURS[j % len(canvas.COLOURS)], width=2
        )
        for j, name in enumerate(robot.joint_names)
    ]
    return (uplot.Series(label="t [s]"), *joints, uplot.Series(label="now", stroke="#888888", width=1))


def table_of(robot: Engine, now: ShownState) -> str:
    """Q, its limits and the base wrench as a table of HTML; names of files are text there."""
    bounds = coordinates.limits(robot.mechanism).bounds("effort")
    rows = []
    for j, (name, unit) in enumerate(zip(robot.joint_names, coordinates.units(robot.mechanism), strict=True)):
        Q, (lower, upper) = float(now.Q[j]), bounds[:, j]
        beyond = " <b>beyond its limit</b>" if not lower <= Q <= upper else ""
        rows.append((escape_html(errors.shorten(name)), f"{Q:.4g} {derivative_unit('Q', 0, unit)}{beyond}"))
    moment, force = (", ".join(f"{x:.4g}" for x in part) for part in (now.F[:3], now.F[3:]))
    rows += [("base force", f"({force}) N"), ("base moment", f"({moment}) N m")]
    body = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in rows)
    return f"<table style='font-size: .8rem; margin: 0 1rem'>{body}</table>"


def legend_of(scene: Scene) -> str:
    """What the arrows are, and what is not drawn."""
    words = "Orange: the force of the ground on the robot, and the loads on its bodies. Blue: the moment of the ground."
    zmp = ["Blue ball: the zero-moment point, at the mean height of the contacts."] if "zmp" in scene.arrows else []
    return "<br>".join(map(escape_html, [words, *zmp, *scene.notes]))


def escape_html(given: str) -> str:
    """A text of a file as HTML."""
    return escape(errors.escape_text(given))


# The server.
HOST = "127.0.0.1"  # other machines see nothing
NAMES_OF_HOST = (HOST, "localhost")  # in addresses of browsers here, and at the near end of a tunnel
FIRST_PORT = 8080  # the first that is tried
_REPLACING = Lock()  # of attributes of modules, which are restored in reverse order


@contextmanager
def serve(port: int | None) -> Iterator["viser.ViserServer"]:
    """Serve an empty page in this context, on a given port, if it is free, or the first free one from `FIRST_PORT`."""
    import viser

    first = FIRST_PORT if port is None else _free_port(port)
    with _REPLACING, _refuse_foreign_pages(), _silence_rich():
        server = viser.ViserServer(host=HOST, port=first, label="jounce", verbose=False)
    try:
        yield server
    finally:
        with _REPLACING, _silence_rich():
            server.stop()


def refusal(headers: Any) -> str | None:
    """Return why a request is refused: its page is not served here, or a name of another host leads here.

    A browser lets the page of any site connect to a WebSocket of this machine; it states the origin of the page.
    Requests without an origin come from programs, which may state what they like.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if urlsplit(f"//{host}").hostname not in NAMES_OF_HOST:
        return f"this server is reached as {' or '.join(NAMES_OF_HOST)}\n"
    if origin is not None and origin != f"http://{host}":
        return "pages of other origins are refused\n"
    return None


@contextmanager
def _refuse_foreign_pages() -> Iterator[None]:
    """Inside, WebSocket servers refuse what `refusal` does; viser has no option for it."""
    server: Any = import_module("websockets.asyncio.server")
    original = server.serve

    def guarded(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            found = refusal(request.headers)
            return process_request(connection, request) if found is None else connection.respond(403, found)

        return original(*arguments, process_request=process, **options)

    server.serve = guarded
    try:
        yield
    finally:
        server.serve = original


@contextmanager
def _silence_rich() -> Iterator[None]:
    """Inside, rich prints nothing, by which viser prints an address of its own; stdout stays as it is."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _free_port(port: int) -> int:
    """A port that is free, any for 0."""
    with socket.socket() as trial:
        try:
            trial.bind((HOST, port))
        except OSError as error:
            raise JounceError(f"port {port} cannot be used: {error.strerror}; choose another by --port") from None
        return int(trial.getsockname()[1])
