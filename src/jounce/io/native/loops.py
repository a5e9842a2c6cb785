"""The loops of a robot file: the frames that each cut joint joins, the actuated joints, and where positions start.

loops:
  - {frames: [left_tip, right_tip]}                           # spherical: the origins meet
  - {frames: [rod, link], joint: revolute, axis: [0, 0, 1]}   # the axis in the first frame
actuated: [left_shoulder, right_shoulder]                     # without loops, joints that follow may be among them
independent: [left_shoulder, right_shoulder]                  # the actuated joints, unless stated
passive: [ankle]                                              # independent, and moved by springs or nothing
weights: {left_shoulder: 1}                                   # of the forces of redundant motors, 1 unless stated
start: {left_shoulder: 2, left_elbow: -1}                     # near a configuration with closed loops, 0 unless stated
"""

from dataclasses import replace

import numpy as np

from jounce.arguments.loops import build_loop, with_loops
from jounce.core.errors import locate_errors
from jounce.core.typing import JsonObject
from jounce.io.entries import Entry
from jounce.model.loops import DEFAULT_LOOP_AXIS, Loop
from jounce.model.mechanism import Mechanism

LOOPS_SECTION, LOOP_KEYS = "loops", ("actuated", "independent", "passive", "weights", "start")


def read(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism with the loops of a file closed; without actuated joints they are kept, open."""
    loops, entries = [], robot.get(LOOPS_SECTION).items(least=1) if LOOPS_SECTION in robot.value else []
    driven = ("actuated", "weights") if "actuated" in robot.value and len(mechanism.joints) > mechanism.n else ()
    for key in LOOP_KEYS:
        if key in robot.value and not entries and key not in driven:
            raise robot.get(key).error(f"{LOOPS_SECTION!r} too, a list of cut joints")
    for entry in entries:
        given = entry.keys(("frames",), ("joint", "axis"))
        frames = [frame.text() for frame in given.get("frames").items()]
        if len(frames) != 2:
            raise given.get("frames").error("two names of frames")
        with locate_errors(given.place):
            joint, axis = (
                given.get("joint", "spherical").text(),
                given.get("axis", list(DEFAULT_LOOP_AXIS)).numbers((3,)),
            )
            loops.append(build_loop(mechanism, frames[0], frames[1], joint, axis))
    mechanism = replace(mechanism, loops=tuple(loops))
    if "actuated" not in robot.value:
        return mechanism
    lists = {
        key: [name.text() for name in robot.get(key).items(least=1)]
        for key in ("actuated", "independent", "passive")
        if key in robot.value
    }
    numbers = {
        key: {name: value.number() for name, value in robot.get(key).members().items()}
        for key in ("weights", "start")
        if key in robot.value
    }
    own = lists.get("independent", None if loops else mechanism.coordinates)
    with locate_errors(robot.get(LOOPS_SECTION if loops else "actuated").place):
        return with_loops(
            mechanism,
            actuated=lists["actuated"],
            coordinates=own,
            start=numbers.get("start"),
            weights=numbers.get("weights"),
            passive=lists.get("passive"),
        )


def write_section(mechanism: Mechanism) -> JsonObject:
    """What a file states of the loops of a mechanism."""
    c, loops = mechanism.closure, [_loop_data(loop) for loop in mechanism.loops]
    stated: JsonObject = {LOOPS_SECTION: loops} if loops else {}
    if c is None:
        return stated
    names = np.array(c.coordinates)
    stated["actuated"] = names[list(c.actuated)].tolist()
    if c.passive:
        stated["passive"] = [mechanism.coordinates[k] for k in c.passive]
    if loops and c.independent != c.actuated:
        stated["independent"] = names[list(c.independent)].tolist()
    if (c.weights != 1).any():
        stated["weights"] = dict(zip(stated["actuated"], c.weights.tolist(), strict=True))
    return stated | ({"start": dict(zip(c.coordinates, c.start.tolist(), strict=True))} if loops else {})


def _loop_data(loop: Loop) -> JsonObject:
    joint = {} if loop.joint == "spherical" else {"joint": loop.joint}
    axis = {} if loop.joint in ("spherical", "fixed") else {"axis": loop.axis.tolist()}
    return {"frames": [loop.a.name, loop.b.name], **joint, **axis}
