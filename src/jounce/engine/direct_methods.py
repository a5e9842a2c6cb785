"""Native code in the place of a robot's methods, for calls with one state of a form that came before.

A form of call, its order and its keywords, is served from the second time on: the method itself has then checked and
computed one, and code is not loaded for a single result. An attribute of the robot hides the method then: a direct
call, which hands all that it does not accept on to the one before, and that to the method. This is a method of another
robot, behind this one, with the same kernels: no circle of references keeps a robot, and a method that was taken from
it outlives it.
"""

import inspect
from collections.abc import Iterator
from types import FunctionType
from typing import Any
from weakref import ref

from jounce.dynamics.computation import Computation, Port
from jounce.engine import certain_digits
from jounce.engine.backends import closing_step, with_constraints
from jounce.engine.engine import Engine, Form
from jounce.native.direct import ClosingTable, Keyword

MAX_DIRECT_FORMS = 24  # of one robot: calls of a method try one after the other, 10 ns each
METHODS: dict[str, FunctionType] = {}  # of robots, by quantity; one of a subclass is not replaced
FRONT, BEHIND = "_front", "_behind"  # attributes of two robots: the other one


def serve(robot: Engine, asked: Computation, form: Form, base_terms: int) -> None:
    """Let native code serve calls like one that came before; `base_terms` is how many arrays of the base it gave."""
    forms, front = robot._kernels.forms, vars(robot).get(FRONT, lambda: robot)()
    kernel, _ = robot._kernels.known.get(asked, (None, None))
    if form not in forms and len(forms) < MAX_DIRECT_FORMS:
        forms[form] = False
        return
    if front is None or kernel is None or forms.get(form, True):
        return
    forms[form] = True
    name, method, closing = form[0], getattr(type(front), form[0], None), _closing_table(robot, asked)
    open_loops = robot.mechanism.takes_dependent and closing is None
    elastic_links = robot.mechanism.elasticity is not None and asked.quantity.of_motors is not None
    if open_loops or elastic_links or method is not METHODS.get(name) or not kernel.direct.are_possible:
        return
    assert method is not None
    keywords, checked = list(_keywords(kernel.signature.inputs, form)), list[Port]()
    pose = next((x.start for x in keywords if x.name == "base"), -1)
    if base_terms and not asked.base:  # it does not enter, but wrong ones never pass
        pose = len(kernel.signature.inputs) + len(kernel.signature.outputs)
        checked = [Port("C", (4, 4), "base"), *[Port("V", (6,), "base")] * (base_terms - 1)]
        keywords.append(Keyword("base", pose, base_terms))
    behind = _robot_behind(front)
    others = vars(front).get(name) or getattr(behind, name)
    taken = [x.replace(annotation=x.empty) for x in inspect.signature(method).parameters.values()]  # C states no types
    doc = f"{name}{str(inspect.Signature(taken)).replace('(self', '($self', 1)}\n--\n\n{method.__doc__}"
    vars(front)[name] = kernel.direct.make(others, keywords, checked, pose, closing, name, doc, behind)


def _closing_table(robot: Engine, asked: Computation) -> ClosingTable | None:
    """What closes the loops of a closed robot, if native code can."""
    step = closing_step(robot) if robot.mechanism.takes_dependent else None
    if step is None or with_constraints(robot, asked) is not robot.mechanism:
        return None
    table = ClosingTable(step, certain_digits.max_condition(asked))
    return table if table.is_possible else None


def _keywords(ports: tuple[Port, ...], form: Form) -> Iterator[Keyword]:
    """The keywords of a form of call that are not the defaults."""
    _, body, frame, method, *_ = form
    for name, value, default in (("body", body, None), ("frame", frame, "body"), ("method", method, None)):
        if value != default:
            yield Keyword(name, value=value)
    for role in ("wrench", "base"):
        places = [k for k, port in enumerate(ports) if port.role == role]
        if places:
            yield Keyword(role, places[0], len(places))


def _robot_behind(robot: Engine) -> Any:
    """The robot whose methods serve what native code does not accept."""
    if BEHIND not in vars(robot):
        behind = object.__new__(type(robot))
        vars(behind).update(vars(robot) | {FRONT: ref(robot)})
        vars(robot)[BEHIND] = behind
    return vars(robot)[BEHIND]
