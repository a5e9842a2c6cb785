"""Shows a robot in the live view: its meshes and frames, and arrows of forces and moments.

A `Track` holds the coordinates, Q, the loads on bodies and the base wrench at many times of a motion; `record_track`
computes it once. `rest_state` computes the same for a robot at rest. `draw_scene` draws everything once, and `show`
moves it to a state, for each picture.
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


MAX_TRACK_STATES = 2000  # all held in memory: a minute at 30 pictures per second


@dataclass(frozen=True, eq=False)
class ShownState:
    """The state that is shown at a time t.

    It consists of q and Q (n,), the base wrench F (6,), the wrenches (6,) that bodies exert, by name, and the pose C of
    the base. `positions` (joints,) are q and, where loops are closed, the positions of the joints that follow.
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
    """The states along a motion: channels at the same times, named as in `ShownState`."""

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
        """Return the state at the nearest time."""
        k = int(np.abs(self.t - t).argmin())
        q, Q, positions, contacts = (x.values[k] for x in (self.q, self.Q, self.positions, self.contacts))
        F, C, zmp = (channel.values[k, 0] for channel in (self.F, self.C, self.zmp))
        wrenches = dict(zip(self.wrenches.names, self.wrenches.values[k], strict=True))
        return ShownState(float(self.t[k]), q, Q, F, wrenches, C, positions, contacts, zmp)


def record_track(robot: Engine, motion: "Motion") -> Track:
    """Compute the states along a motion.

    Their times are those of the motion or, of many, evenly spaced ones.
    """
    # Contacts, loads and the base wrench need the states themselves, next to what `forces_along` gives.
    t, m = motion.times, robot.mechanism
    if len(t) > MAX_TRACK_STATES:
        t = np.linspace(motion.start, motion.stop, MAX_TRACK_STATES)
    traced = along.forces_along(robot, motion, t, 0)
    path = along.check_motion(m, motion)  # in the order of the robot's joints
    states = MotionStates.sample(robot, path, t, [(QUANTITIES["base_wrench"], 0)])
    loads, [F] = states.wrench[0] if states.wrench else {}, states.compute(robot, "base_wrench")
    poses = traced.base_motion[0].values if traced.base_motion else np.tile(np.eye(4), (len(t), 1, 1, 1))
    body_wrenches = np.stack([*loads.values()], axis=1) if loads else np.zeros((len(t), 0, 6))
    joint_positions = states.rates[0] if states.near is None else states.near
    joints = positions.names(m.tree) if states.near is not None else traced.coordinates[0].names
    frames = [contact.frame for contact in m.contacts]

    def channel(symbol: str, names: Sequence[str], unit: str, values: np.ndarray) -> Channel:
        return Channel(symbol, tuple(names), (unit,) * len(names), t, (values,))

    return Track(
        traced.coordinates[0].upto(0),
        traced.efforts.columns(range(-robot.n, 0)),
        channel("F", ["base"], "N m and N", F[:, None]),
        channel("W", [*loads], "N m and N", body_wrenches),
        channel("C", ["base"], "1 and m", poses),
        channel("q", joints, "", joint_positions),
        channel("contact", frames, "m", balance_points.contact_lines(robot, states)),
        channel("zmp", ["zmp"], "m", balance_points.zmp_points(robot, states)[:, None]),
    )


def rest_state(robot: Engine, q: np.ndarray, C: np.ndarray, nearby_positions: np.ndarray | None = None) -> ShownState:
    """Return the state of a robot at rest at q.

    Its base is at C, and there are no loads. Loops are closed from the positions nearby.
    """
    joint_positions = (
        loop_closure.close_loops(robot.mechanism, q[None], nearby_positions)[0] if robot.mechanism.is_closed else q
    )
    rest, base = np.zeros(robot.n), (C, np.zeros(6), np.zeros(6))
    Q, F = (
        compute(robot, name, (joint_positions, rest, rest), base=base)
        for name in (DEFAULT_QUANTITY.name, "base_wrench")
    )
    states = MotionStates((q, rest, rest), None, base, None)
    balance = balance_points.contact_lines(robot, states), balance_points.zmp_points(robot, states)
    return ShownState(0.0, q, Q[-robot.n :], F, {}, C, joint_positions, *balance)


# The scene that is drawn: links in one colour, joints in another.
JOINT_COLOUR = "#3d6b8e"
FORCE_COLOUR, MOMENT_COLOUR = (213, 94, 0), (0, 114, 178)
ZMP_COLOUR, ZMP_RADIUS = (0, 0, 224), 0.02  # of the robot's size
ARROW_LENGTH = 0.35  # of the robot's size: the longest arrow
UNSEEN_ARROW = np.zeros((1, 2, 3))  # an arrow that is not seen


@dataclass(frozen=True, eq=False)
class Scene:
    """The handles of all that moves: ground or base, bodies, frames, and arrows by name."""

    robot: Engine
    size: float
    ground: Any
    bodies: Sequence[Any]
    frames: Sequence[Any]
    arrows: Mapping[str, "viser.ArrowsHandle"]
    soles: Any  # None without contacts, as is `zmp`
    zmp: Any
    largest: Mapping[str, float]  # force and moment, of the longest arrow
    notes: Sequence[str]  # on meshes that are not drawn


def draw_scene(
    server: "viser.ViserServer", robot: Engine, file: Path, along: Track | None, folders: Sequence[Path]
) -> Scene:
    """Draw a robot with the shapes of its file.

    Links without shapes are drawn from their joints and frames.
    """
    m, start = robot.mechanism.tree, positions.start(robot.mechanism)
    size = robot_size(m, poses_on(robot, start, np.eye(4)))
    server.scene.add_grid("/grid", width=4 * size, height=4 * size, cell_size=size / 5, section_size=size)
    ground = server.scene.add_frame(_node(m, GROUND_BODY), show_axes=False)
    bodies, frames = [], []
    for node in (_node(m, i) for i in m.moving_bodies):
        bodies.append(server.scene.add_frame(node, show_axes=False))
        name, long, thick = f"{node}/frame", 0.12 * size, 0.005 * size
        frames.append(server.scene.add_frame(name, axes_length=long, axes_radius=thick, visible=False))
    bodies_with_visuals, notes = _draw_visuals(server, robot, file, folders)
    for k, part in enumerate(parts_of(m, size, to_single_screws(m, start[None]), JOINT_COLOUR)):
        if part.body not in bodies_with_visuals:
            colour = np.frombuffer(bytes.fromhex(part.colour.removeprefix("#")), np.uint8)
            server.scene.add_mesh_simple(f"{_node(m, part.body)}/part{k}", part.vertices, part.triangles, color=colour)
    # Arrows are made once, of no length, and are set by `show`.
    arrow_shape: Any = {"shaft_radius": 0.01 * size, "head_radius": 0.025 * size, "head_length": 0.05 * size}
    colours = {"base force": FORCE_COLOUR, "base moment": MOMENT_COLOUR}
    colours |= {f"contact {k}": FORCE_COLOUR for k in range(len(m.contacts))}
    colours |= {f"load {k}": FORCE_COLOUR for k in range(len(along.wrenches.names) if along is not None else 0)}
    arrows = {
        name: server.scene.add_arrows(f"/{name}", UNSEEN_ARROW, colour, **arrow_shape)
        for name, colour in colours.items()
    }
    soles = server.scene.add_line_segments("/soles", UNSEEN_ARROW, FORCE_COLOUR) if m.contacts else None
    zmp = server.scene.add_icosphere("/zmp", 0.0, ZMP_COLOUR) if m.contacts else None
    return Scene(robot, size, ground, bodies, frames, arrows, soles, zmp, _largest(robot, along, size), notes)


def show(scene: Scene, state: ShownState) -> None:
    """Move the robot to a state, and draw its forces and moments."""
    # The frame of the ground carries a fixed or floating base; the others are those of moving bodies.
    m = scene.robot.mechanism
    poses = poses_on(scene.robot, state.positions, state.C)
    for body, C in zip((scene.ground, *scene.bodies), (state.C, *poses[m.moving_bodies.start :]), strict=True):
        body.wxyz, body.position = lie.to_quaternion(C[:3, :3]), C[:3, 3]
    # Arrows by name: the point from which each starts, and its vector in N or N m.
    vectors = {"base moment": (np.zeros(3), state.F[:3]), "base force": (np.zeros(3), state.F[3:])}
    for k, (name, W) in enumerate(state.wrenches.items()):
        frame = m.frame(name)
        C = (poses[frame.body] if frame.body != GROUND_BODY else state.C) @ np.asarray(frame.T, dtype=float)
        # W is what the body exerts; the arrow shows the force on the body.
        vectors[f"load {k}"] = C[:3, 3], -C[:3, :3] @ W[3:]
    # Contacts that do not press have NaN, and an arrow of no length.
    for k, (start, end) in enumerate(np.nan_to_num(state.contacts[:, balance_points.FORCE_ENDS])):
        vectors[f"contact {k}"] = start, end - start
    edges = state.contacts[:, balance_points.SOLE_EDGE]
    if edges.size > 0:
        scene.soles.points = np.stack([edges[:, :-1], edges[:, 1:]], axis=2).reshape(-1, 2, 3)
        ball, is_visible = scene.zmp, np.isfinite(state.zmp).all()
        ball.position, ball.radius = np.nan_to_num(state.zmp), ZMP_RADIUS * scene.size * float(is_visible)
    for name, (start, vector) in vectors.items():
        scale = ARROW_LENGTH * scene.size / scene.largest["moment" if name == "base moment" else "force"]
        # The force of a contact ends at it: above, the leg would hide the arrow.
        tail = start - scale * vector * name.startswith("contact")
        scene.arrows[name].points = np.array([[tail, tail + scale * vector]])


def _largest(robot: Engine, along: Track | None, size: float) -> dict[str, float]:
    """Return the largest force and moment that arrows show.

    They are at least those of the weight, so that small forces have small arrows.
    """
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
    """Draw the visuals of a robot file.

    Return the bodies that have visuals, and notes on visuals that cannot be drawn.
    """
    m = robot.mechanism
    placed, unreadable = place_visuals(m, visuals.robot_visuals(m, file), file, folders)
    for k, (body, C, mesh) in enumerate(placed):
        name, turn = f"{_node(m, body)}/visual{k}", lie.to_quaternion(C[:3, :3])
        server.scene.add_mesh_trimesh(name, mesh, wxyz=turn, position=C[:3, 3])
    notes = [f"not drawn: {join_names(dict.fromkeys(unreadable))}"] if len(unreadable) > 0 else []
    return {body for body, _, _ in placed}, notes


def _node(m: Mechanism, body: int) -> str:
    """Return the name of the node of a body.

    A floating base has that of the ground.
    """
    k = body - m.moving_bodies.start
    return f"/body{k}" if k >= 0 else "/ground"


def check_installed() -> None:
    """Raise `JounceError` if viser is missing."""
    with errors.optional_import("the live view needs viser", "view"):
        import viser  # noqa: F401
