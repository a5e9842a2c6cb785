"""Serves the live view: a robot in a browser on this machine, by viser.

`serve_robot` draws the scene and adds the controls: sliders of the joints, the values and curves of Q, and a legend. A
`Viewer` holds them, and `run` plays the motion. The server accepts browsers on this machine and its own page only, and
prints nothing. Its page is that of viser with another head: the name of the robot as title, and names of the controls
for screen readers.
"""

import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from http import HTTPStatus
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


HERE = Path(__file__).parent
CURVE_UPDATE_PERIOD = 0.2  # s: curves are sent as a whole, which takes longer than poses


@dataclass(eq=False)
class Viewer:
    """A robot that is served, with its controls.

    The time changes, and whether the motion runs.
    """

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
    setting: bool = False  # whether the program sets the sliders, not the user
    drawn: float = -np.inf  # the time at which the curves were drawn last
    positions: np.ndarray = field(default_factory=lambda: np.zeros(0))  # of all joints, as they are shown

    @property
    def base(self) -> np.ndarray:
        """The pose of the base at the time of the slider."""
        return np.eye(4) if self.along is None else self.along.at(self.time.value).C

    @property
    def address(self) -> str:
        """The address for browsers."""
        return f"http://{HOST}:{self.server.get_port()}"

    def rest(self) -> None:
        """Show the robot at rest at the positions of the sliders."""
        with self.busy:
            # Each slider that the program sets reports a change: the user has changed nothing then.
            if self.setting:
                return
            if self.playing is not None:
                self.playing.value = False
            q = from_single_screws(self.scene.robot.mechanism, np.array([slider.value for slider in self.joints]))
            try:
                self._show(rest_state(self.scene.robot, q, self.base, self.positions))
            except JounceError as error:
                # Loops cannot be closed, or contacts do not balance the robot: the sliders go back.
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
        """Set the sliders of the joints to q."""
        self.setting = True
        for slider, x in zip(self.joints, q, strict=True):
            slider.value = float(x)
        self.setting = False

    def tick(self, seconds: float, clock: float) -> None:
        """Advance the motion by some seconds; after its end it starts again.

        `clock` is the time by which curves are drawn again, at most once per `CURVE_UPDATE_PERIOD`.
        """
        if self.along is None:
            return
        if self.playing.value:
            first, last = self.along.t[[0, -1]]
            time = self.time.value + seconds * self.speed.value
            self.time.value = float(time if time <= last else first)
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
    """Serve a robot in this context, along a motion if given.

    Its file, and meshes in folders, have its shapes.
    """
    with serve(port, robot.name) as server:
        yield _fill(server, robot, file, along, folders)


def _fill(
    server: "viser.ViserServer", robot: Engine, file: Path, along: Track | None, folders: Sequence[Path]
) -> Viewer:
    """Draw the scene, add the controls, and connect them to a viewer."""
    scene, gui = draw_scene(server, robot, file, along, folders), server.gui
    server.initial_camera.position = tuple(scene.size * np.array([1.3, -1.3, 1.0]))
    server.initial_camera.look_at = (0.0, 0.0, 0.35 * scene.size)
    gui.add_html(f"<b style='margin: 0 1rem'>{escape_html(robot.name)}</b>")
    # Without a motion there are no controls of time.
    time = plot = playing = speed = None
    if along is not None:
        with gui.add_folder("Motion"):
            first, last = map(float, along.t[[0, -1]])
            time = gui.add_slider("t [s]", first, last, max((last - first) / 1e4, 1e-6), first)
            playing = gui.add_checkbox("play", False)
            speed = gui.add_slider("speed", 0.05, 2.0, 0.05, 1.0)
            plot = gui.add_uplot(
                *(curves_of(along, first), series_of(robot)),
                title="Q [N m or N] over t [s]", aspect=1.4, scales={"x": {"time": False}},
            )  # fmt: skip
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
    # The first picture.
    if along is not None:
        viewer.move()
    else:
        viewer.rest()
    return viewer


def _set_visible(handles: Any, visible: bool) -> None:
    for handle in handles:
        handle.visible = visible


def run(viewer: Viewer, stopped: Callable[[float], bool]) -> None:
    """Play until `stopped`, which waits for some seconds, returns True."""
    from time import monotonic

    last_time = monotonic()
    while not stopped(1 / 30):
        now = monotonic()
        viewer.tick(now - last_time, now)
        last_time = now


# Controls.
DISPLAY_NOISE = 1e-12  # of the largest force, at least of 1 N or 1 N m: the rounding of what is 0
VIEW_CURVE_POINTS = 400  # of a curve: it is sent again five times per second
TIME_MARK_WIDTH = 1e-4  # of the duration: the width of the mark of the time


def joint_sliders(gui: Any, robot: Engine, along: Track | None) -> list[Any]:
    """Add a slider for each single screw.

    It spans the limits and the positions of the motion.
    """
    q = np.zeros((0, robot.n)) if along is None else to_single_screws(robot.mechanism, along.q.values)
    lowest, highest = slider_ranges(robot.mechanism, q)
    m = robot.mechanism
    rest = positions.start(m)[list(m.independent_places)] if m.is_closed else np.zeros(robot.n)
    starts = rest.clip(lowest, highest) if along is None else q[0]
    sliders = []
    columns = (robot.joint_names, coordinates.units(robot.mechanism), *(x.tolist() for x in (lowest, highest, starts)))
    for name, unit, lower, upper, start in zip(*columns, strict=True):
        label = f"{errors.escape_text(errors.shorten(name))} [{unit}]"
        sliders.append(gui.add_slider(label, lower, upper, max((upper - lower) / 2000, 1e-9), start))
    return sliders


def curves_of(along: Track, t: float) -> tuple[np.ndarray, ...]:
    """Return times, Q of each joint, and a mark of a time.

    The mark is a curve with a peak.
    """
    # The peak needs three times of its own; Q is interpolated there.
    first, last = along.t[[0, -1]]
    width = TIME_MARK_WIDTH * (last - first)
    rows = np.unique(np.linspace(0, len(along.t) - 1, VIEW_CURVE_POINTS).astype(int))
    mark_times = np.clip([t - width, t, t + width], first, last)
    times = np.unique([*along.t[rows], *mark_times])
    Q = along.Q.values
    low, high = float(Q.min()), float(Q.max())
    mark = np.where(np.abs(times - t) < width / 2, high, low)
    return (times, *(np.interp(times, along.t, column) for column in Q.T), mark)


def series_of(robot: Engine) -> tuple[Any, ...]:
    """Return the styles of the curves of `curves_of`."""
    from viser import uplot

    joints = [
        uplot.Series(
            label=errors.escape_text(errors.shorten(name)), stroke=canvas.COLOURS[j % len(canvas.COLOURS)], width=2
        )
        for j, name in enumerate(robot.joint_names)
    ]
    return (uplot.Series(label="t [s]"), *joints, uplot.Series(label="now", stroke="#888888", width=1))


def table_of(robot: Engine, state: ShownState) -> str:
    """Return Q and the base wrench as a table of HTML.

    Names are escaped. Values beyond their limits are marked.
    """
    bounds = coordinates.limits(robot.mechanism).bounds("effort")
    noise = DISPLAY_NOISE * max(1.0, float(np.abs([*state.Q, *state.F]).max()))
    rows = []
    for j, (name, unit) in enumerate(zip(robot.joint_names, coordinates.units(robot.mechanism), strict=True)):
        Q, (lower, upper) = float(state.Q[j]), bounds[:, j]
        warning = " <b>beyond its limit</b>" if not lower <= Q <= upper else ""
        value = f"{format_number(Q, noise)} {derivative_unit('Q', 0, unit)}{warning}"
        rows.append((escape_html(errors.shorten(name)), value))
    moment, force = (", ".join(format_number(x, noise) for x in part) for part in (state.F[:3], state.F[3:]))
    rows += [("base force", f"({force}) N"), ("base moment", f"({moment}) N m")]
    body = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in rows)
    return f"<table style='font-size: .8rem; margin: 0 1rem'>{body}</table>"


def format_number(x: float, noise: float) -> str:
    """Return a number of four digits, and 0 for one below the noise."""
    return f"{x:.4g}" if abs(x) > noise else "0"


def legend_of(scene: Scene) -> str:
    """Return the legend of the arrows, and notes on undrawn parts."""
    words = "Orange: the force of the ground on the robot, and the loads on its bodies. Blue: the moment of the ground."
    zmp_words = (
        ["Blue ball: the zero-moment point, at the mean height of the contacts."] if "zmp" in scene.arrows else []
    )
    return "<br>".join(map(escape_html, [words, *zmp_words, *scene.notes]))


def escape_html(text: str) -> str:
    """Return a text of a file as HTML."""
    return escape(errors.escape_text(text))


# The server.
HOST = "127.0.0.1"  # other machines see nothing
NAMES_OF_HOST = (HOST, "localhost")  # in addresses of browsers here, and at the near end of a tunnel
TITLE_OF_VISER = b"<title>Viser</title>"
FIRST_PORT = 8080  # the first port that is tried
_REPLACING = Lock()  # held while attributes of modules are replaced, which must be restored in reverse order


@contextmanager
def serve(port: int | None, title: str) -> Iterator["viser.ViserServer"]:
    """Serve an empty page with a title in this context.

    The port is the given one, which must be free, or the first free one from `FIRST_PORT`.
    """
    import viser

    first = FIRST_PORT if port is None else _free_port(port)
    with _REPLACING, _own_requests(title), _silence_rich():
        server = viser.ViserServer(host=HOST, port=first, label="jounce", verbose=False)
    try:
        yield server
    finally:
        with _REPLACING, _silence_rich():
            server.stop()


def refusal(headers: Any) -> str | None:
    """Return the reason why a request is refused, or None.

    It is refused if its page is not served here, or if the name of another host leads here. A browser lets the page of
    any site connect to a WebSocket of this machine, and sends the origin of the page. Requests without an origin come
    from programs, which could send any origin.
    """
    host, origin = headers.get("Host", ""), headers.get("Origin")
    if urlsplit(f"//{host}").hostname not in NAMES_OF_HOST:
        return f"this server is reached as {' or '.join(NAMES_OF_HOST)}\n"
    if origin is not None and origin != f"http://{host}":
        return "pages of other origins are refused\n"
    return None


def set_head(response: Any, title: str) -> None:
    """Give a page of viser a title, and names of its controls.

    Other files, and pages without the title of viser, stay as they are.
    """
    head = f"<title>{escape_html(title)}</title>\n{(HERE / 'view_head.html').read_text(encoding='utf-8')}"
    response.body = response.body.replace(TITLE_OF_VISER, head.encode(), 1)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@contextmanager
def _own_requests(title: str) -> Iterator[None]:
    """Make WebSocket servers refuse by `refusal`, and serve pages with a title.

    viser has no option for either.
    """
    server: Any = import_module("websockets.asyncio.server")
    original = server.serve

    def guarded(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            reason = refusal(request.headers)
            if reason is not None:
                return connection.respond(403, reason)
            # The page is changed as text: it must not be compressed.
            if "Accept-Encoding" in request.headers:
                del request.headers["Accept-Encoding"]
            response = process_request(connection, request)
            if response is not None and response.status_code == HTTPStatus.OK:
                set_head(response, title)
            return response

        return original(*arguments, process_request=process, **options)

    server.serve = guarded
    try:
        yield
    finally:
        server.serve = original


@contextmanager
def _silence_rich() -> Iterator[None]:
    """Silence rich in this context, by which viser prints its own address.

    stdout stays as it is.
    """
    import rich

    console = rich.get_console()
    previous_quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = previous_quiet


def _free_port(port: int) -> int:
    """Return a port if it is free; 0 returns any free port."""
    with socket.socket() as trial:
        try:
            trial.bind((HOST, port))
        except OSError as error:
            raise JounceError(f"port {port} cannot be used: {error.strerror}; choose another with --port") from None
        return int(trial.getsockname()[1])
