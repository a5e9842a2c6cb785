"""Shows a robot in the live view: its meshes and frames, and arrows of forces and moments.

A `Track` is what is shown along a motion: the coordinates, Q, the loads on bodies and the base wrench at many times,
computed once by `record_track`; `rest_state` is the same for a robot that rests. `draw_scene` makes the handles of what
moves, once, and `show` moves them to a state, each time that one is shown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._report.drawing import GROUND_BODY, parts_of, robot_size, to_single_screws
from jounce._report.meshes import place_visuals
from jounce.core import errors
from jounce.core.errors import join_names
from jounce.dynamics import loop_closure
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine import along, balance_points
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute
from jounce.figures.drawing import poses_on
from jounce.io import visuals
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.motion.channel import Channel
from jounce.spatial import lie

if TYPE_CHECKING:
    import viser

    from jounce.motion import Motion


MAX_TRACK_STATES = 2000  # of a motion, all held in memory: at 30 pictures per second those of a minute


@dataclass(frozen=True, eq=False)
class ShownState:
    """What is shown at a time t: q, Q (n,), the base wrench F (6,), what bodies exert, (6,) by name, the base's pose.

    `positions` (joints,) are q, and where loops are closed the positions of the joints that follow too.
    """

    t: float
    q: np.ndarray
    Q: np.ndarray
    F: np.ndarray
    wrenches: Mapping[str, np.ndarray]
    C: np.ndarray  # (4, 4)
    positions: np.ndarray
    contacts: np.ndarray  # (contacts, 9, 3), see `contact_lines`
    zmp: np.ndarray  # (3,), see `zmp_points`


@dataclass(frozen=True, eq=False)
class Track:
    """What is shown along a motion: channels at the same times, named as the arrays of a state."""

    q: Channel
    Q: Channel
    F: Channel  # (N, 1, 6)
    wrenches: Channel  # (N, bodies, 6)
    C: Channel  # (N, 1, 4, 4)
    positions: Channel
    contacts: Channel  # (N, contacts, 9, 3)
    zmp: Channel  # (N, 1, 3)

    @property
    def t(self) -> np.ndarray:
        """Times (N,) in s."""
        return self.q.times

    def at(self, t: float) -> ShownState:
        """What is shown at the time that is nearest to one."""
        k = int(np.abs(self.t - t).argmin())
        q, Q, positions, contacts = (x.values[k] for x in (self.q, self.Q, self.positions, self.contacts))
        F, C, zmp = (channel.values[k, 0] for channel in (self.F, self.C, self.zmp))
        wrenches = dict(zip(self.wrenches.names, self.wrenches.values[k], strict=True))
        return ShownState(float(self.t[k]), q, Q, F, wrenches, C, positions, contacts, zmp)


def record_track(robot: Engine, motion: "Motion") -> Track:
    """A motion of a robot, which must be of its joints, at its own times or, of many, at evenly spaced ones."""
    t, m = motion.times, robot.mechanism
    if len(t) > MAX_TRACK_STATES:
        t = np.linspace(motion.start, motion.stop, MAX_TRACK_STATES)
    traced = along.forces_along(robot, motion, t, 0)
    path = along.check_motion(m, motion)  # in the order of the robot's joints
    states = MotionStates.sample(robot, path, t, [(QUANTITIES["base_wrench"], 0)])
    loads, [F] = states.wrench[0] if states.wrench else {}, states.compute(robot, "base_wrench")
    poses = traced.base_motion[0].values if traced.base_motion else np.tile(np.eye(4), (len(t), 1, 1, 1))
    of_bodies = np.stack([*loads.values()], axis=1) if loads else np.zeros((len(t), 0, 6))
    whole = states.rates[0] if states.near is None else states.near
    joints = positions.names(m.tree) if states.near is not None else traced.coordinates[0].names
    frames = [contact.frame for contact in m.contacts]

    def channel(symbol: str, names: Sequence[str], unit: str, values: np.ndarray) -> Channel:
        return Channel(symbol, tuple(names), (unit,) * len(names), t, (values,))

    return Track(
        traced.coordinates[0].upto(0),
        traced.efforts.columns(range(-robot.n, 0)),
        channel("F", ["base"], "N m and N", F[:, None]),
        channel("W", [*loads], "N m and N", of_bodies),
        channel("C", ["base"], "1 and m", poses),
        channel("q", joints, "", whole),
        channel("contact", frames, "m", balance_points.contact_lines(robot, states)),
        channel("zmp", ["zmp"], "m", balance_points.zmp_points(robot, states)[:, None]),
    )


def rest_state(robot: Engine, q: np.ndarray, C: np.ndarray, near: np.ndarray | None = None) -> ShownState:
    """The state of a robot that rests at q, its base at C, without loads; loops are closed from positions nearby."""
    whole = loop_closure.close_loops(robot.mechanism, q[None], near)[0] if robot.mechanism.is_closed else q
    rest, base = np.zeros(robot.n), (C, np.zeros(6), np.zeros(6))
    Q, F = (compute(robot, name, (whole, rest, rest), base=base) for name in (DEFAULT_QUANTITY.name, "base_wrench"))
    states = MotionStates((q, rest, rest), None, base, None)
    drawn = balance_points.contact_lines(robot, states), balance_points.zmp_points(robot, states)
    return ShownState(0.0, q, Q[-robot.n :], F, {}, C, whole, *drawn)


# The scene that is drawn.
FORCE_COLOUR, MOMENT_COLOUR = (213, 94, 0), (0, 114, 178)
ZMP_COLOUR, ZMP_RADIUS = (0, 0, 224), 0.02  # of the robot's size
ARROW_LENGTH = 0.35  # of the robot's size: the longest arrow
UNSEEN_ARROW = np.zeros((1, 2, 3))  # an arrow that is not seen


@dataclass(frozen=True, eq=False)
class Scene:
    """The handles of what moves: the frames of the ground or base and of the bodies, and arrows by what they show."""

    robot: Engine
    size: float
    ground: Any
    bodies: Sequence[Any]
    frames: Sequence[Any]
    arrows: Mapping[str, "viser.ArrowsHandle"]
    soles: Any  # None where nothing stands on contacts, as is the zero-moment point
    zmp: Any
    largest: Mapping[str, float]  # force and moment, of the longest arrow
    notes: Sequence[str]  # on meshes that are not drawn


def draw_scene(
    server: "viser.ViserServer", robot: Engine, file: Path, along: Track | None, folders: Sequence[Path]
) -> Scene:
    """Draw a robot as its file shows it; links without shapes there are drawn from their joints and frames."""
    m, start = robot.mechanism.tree, positions.start(robot.mechanism)
    size = robot_size(m, poses_on(robot, start, np.eye(4)))
    server.scene.add_grid("/grid", width=4 * size, height=4 * size, cell_size=size / 5, section_size=size)
    ground = server.scene.add_frame(_node(m, GROUND_BODY), show_axes=False)
    bodies, frames = [], []
    for node in (_node(m, i) for i in m.moving_bodies):
        bodies.append(server.scene.add_frame(node, show_axes=False))
        name, long, thick = f"{node}/frame", 0.12 * size, 0.005 * size
        frames.append(server.scene.add_frame(name, axes_length=long, axes_radius=thick, visible=False))
    seen, notes = _draw_visuals(server, robot, file, folders)
    for k, part in enumerate(parts_of(m, size, to_single_screws(m, start[None]))):
        if part.body not in seen:
            colour = np.frombuffer(bytes.fromhex(part.colour.removeprefix("#")), np.uint8)
            server.scene.add_mesh_simple(f"{_node(m, part.body)}/part{k}", part.vertices, part.triangles, color=colour)
    shape: Any = {"shaft_radius": 0.01 * size, "head_radius": 0.025 * size, "head_length": 0.05 * size}
    colours = {"base force": FORCE_COLOUR, "base moment": MOMENT_COLOUR}
    colours |= {f"contact {k}": FORCE_COLOUR for k in range(len(m.contacts))}
    colours |= {f"load {k}": FORCE_COLOUR for k in range(len(along.wrenches.names) if along is not None else 0)}
    arrows = {
        name: server.scene.add_arrows(f"/{name}", UNSEEN_ARROW, colour, **shape) for name, colour in colours.items()
    }
    soles = server.scene.add_line_segments("/soles", UNSEEN_ARROW, FORCE_COLOUR) if m.contacts else None
    zmp = server.scene.add_icosphere("/zmp", 0.0, ZMP_COLOUR) if m.contacts else None
    return Scene(robot, size, ground, bodies, frames, arrows, soles, zmp, _largest(robot, along, size), notes)


def show(scene: Scene, now: ShownState) -> None:
    """Move the robot to a state, and draw the forces and moments of it."""
    m = scene.robot.mechanism
    poses = poses_on(scene.robot, now.positions, now.C)
    for body, C in zip((scene.ground, *scene.bodies), (now.C, *poses[m.moving_bodies.start :]), strict=True):
        body.wxyz, body.position = lie.to_quaternion(C[:3, :3]), C[:3, 3]
    vectors = {"base moment": (np.zeros(3), now.F[:3]), "base force": (np.zeros(3), now.F[3:])}
    for k, (name, W) in enumerate(now.wrenches.items()):
        frame = m.frame(name)
        C = (poses[frame.body] if frame.body != GROUND_BODY else now.C) @ np.asarray(frame.T, dtype=float)
        vectors[f"load {k}"] = C[:3, 3], -C[:3, :3] @ W[3:]  # on the body
    for k, (start, end) in enumerate(
        np.nan_to_num(now.contacts[:, balance_points.FORCE_ENDS])
    ):  # nothing where nothing presses
        vectors[f"contact {k}"] = start, end - start
    if (edges := now.contacts[:, balance_points.SOLE_EDGE]).size:
        scene.soles.points = np.stack([edges[:, :-1], edges[:, 1:]], axis=2).reshape(-1, 2, 3)
        ball, seen = scene.zmp, np.isfinite(now.zmp).all()
        ball.position, ball.radius = np.nan_to_num(now.zmp), ZMP_RADIUS * scene.size * float(seen)
    for name, (start, vector) in vectors.items():
        scale = ARROW_LENGTH * scene.size / scene.largest["moment" if name == "base moment" else "force"]
        first = start - scale * vector * name.startswith("contact")  # from below: the leg would hide it
        scene.arrows[name].points = np.array([[first, first + scale * vector]])


def _largest(robot: Engine, along: Track | None, size: float) -> dict[str, float]:
    """The largest force and moment that arrows show: along a motion, and the weight."""
    m = robot.mechanism
    weight = float(m.M[:, 3, 3].sum() * np.linalg.norm(np.asarray(m.gravity, dtype=float)))
    force = moment = 0.0
    if along is not None:
        force = max(float(np.linalg.norm(x.values[..., 3:], axis=-1).max(initial=0)) for x in (along.F, along.wrenches))
        moment = float(np.linalg.norm(along.F.values[..., :3], axis=-1).max())
    return {"force": max(weight, force) or 1.0, "moment": max(moment, weight * size / 4) or 1.0}


def _draw_visuals(
    server: "viser.ViserServer", robot: Engine, file: Path, folders: Sequence[Path]
) -> tuple[set[int], list[str]]:
    """Draw the visuals of a robot file; the bodies that they show, and what could not be drawn."""
    m = robot.mechanism
    placed, missed = place_visuals(m, visuals.robot_visuals(m, file), file, folders)
    for k, (body, C, mesh) in enumerate(placed):
        name, turn = f"{_node(m, body)}/visual{k}", lie.to_quaternion(C[:3, :3])
        server.scene.add_mesh_trimesh(name, mesh, wxyz=turn, position=C[:3, 3])
    return {body for body, _, _ in placed}, [f"not drawn: {join_names(dict.fromkeys(missed))}"] if missed else []


def _node(m: Mechanism, body: int) -> str:
    """The name of what moves as a body: a floating base as the ground."""
    k = body - m.moving_bodies.start
    return f"/body{k}" if k >= 0 else "/ground"


def check_installed() -> None:
    """Raise `JounceError` where viser, which serves the view, is missing."""
    with errors.optional_import("the live view needs viser", "view"):
        import viser  # noqa: F401
