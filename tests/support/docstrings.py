"""Docstrings of the methods that compute quantities, composed from their rows."""

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from textwrap import fill
from typing import NamedTuple

from jounce.dynamics.quantities import Quantity
from jounce.dynamics.quantities.row import CLOSED, ELASTIC
from jounce.spatial.series import rate_name

DOCSTRING_WIDTH = 112  # characters of a line: 120, less the indent of a method


class MethodOption(NamedTuple):
    """A keyword of methods: its type and default in sources, and its description."""

    annotation: str
    default: str
    takes: str
    text: str


METHOD_OPTIONS = {
    "wrench": MethodOption(
        "Rates | None", "None", "(..., nb, 6) or dict, or a tuple of them, optional",
        "What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about the"
        " origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has{more}; anything"
        " else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {{body or merged link: (...,"
        " 6)}}. Wd is the derivative of those components.",
    ),
    "stiffness": MethodOption(
        "Rates | None", "None", "(..., k) or mapping, or a tuple of them, optional",
        "The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.",
    ),
    "drives": MethodOption(
        "DriveTerms", "False", "bool, str or iterable of str, optional",
        'Columns to append: nb, one per joint variable, for each of "armature", "damping", "friction", "stribeck",'
        ' "spring" and "offset", in this order; True appends these. Their parameters are those of `Robot.drives`, of'
        " the spring its stiffness; speeds of friction and the rest position of the spring are those of the robot.",
    ),
    "form": MethodOption("Form", "'paper'", "str, optional", '"paper" or "skew".'),
    "body": MethodOption(
            "str | None", "None", "str, optional", "A body or a link merged into one; all bodies by default."
        ),
    "frame": MethodOption(
        "Frame", "'body'", "str, optional",
        'Frame of the twists (angular; linear): "body" (the paper\'s body-fixed twist), "world" (world axes, origin of'
        ' the body frame: the hybrid form) or "spatial" (the paper\'s spatial twist).',
    ),
    "base": MethodOption("Rates | None", "None", "", ""),
    "method": MethodOption("Method | None", "None", "", ""),
    "out": MethodOption("Out", "None", "", ""),
    "threads": MethodOption("int", "1", "", ""),
}  # fmt: skip
SHARED_OPTIONS = ("base", "method", "out", "threads")
FORCES_TEXT = (
    "Generalized forces: N m, or N for coordinates in m. If the robot floats, they begin with the wrench (moment;"
    " force) that acts on the base, in its axes: zero in flight."
)
MOTORS = {
    "tau": "Motor torques: N m, or N for coordinates in m.",
    "q4d": "The wanted fourth time derivative of q: rad/s^4 or m/s^4.",
}
COORDINATE_TEXTS = {
    1: "Coordinates: rad or m.",
    2: "Coordinates and velocities: rad or m, per s.",
    3: "Coordinates, velocities and accelerations: rad or m, per s, per s^2.",
}
# where they are not called as in rows
AXIS_LENGTHS = {"bodies": "nb", "parameters": "10 nb", "tree": "N", "motors": "k"}


def list_options(row: Quantity) -> tuple[str, ...]:
    """The keywords of the method of a quantity."""
    takes, frame = row.takes, ("frame",) * bool(row.gives.frames)
    of_joints = ("wrench",) * takes.wrenches + ("stiffness",) * row.takes_stiffness
    return (*of_joints, *takes.options, *("body",) * row.of_bodies, *frame, *SHARED_OPTIONS)


def docstring(row: Quantity) -> str:
    """The docstring of the method of a quantity."""
    text = row.printed.text
    cut = min(text.find(f"{title}\n---") % (len(text) + 1) for title in ("References", "Examples"))
    head, tail = text[:cut].rstrip(), text[cut:]
    place = [f"Computed by `{row.laws['recursion'].__module__}`."]
    if row.of_motors:
        links = f"Where joints are elastic, it is that of the links; `{row.of_motors}` is that of the motors."
        place.insert(0, fill(links, DOCSTRING_WIDTH, break_on_hyphens=False))
    taken, returned = _section("Parameters", _parameter_texts(row)), _section("Returns", [_returns(row)])
    refusals = _refusals(row)
    errors = [_section("Raises", [("JounceError", f"If {_join_last(refusals)}.")])] if refusals else []
    return "\n\n".join([head, *place, taken, returned, *errors, tail])


def _section(title: str, entries: Iterable[tuple[str, str]]) -> str:
    lines = [title, "-" * len(title)]
    for name, text in entries:
        lines += [name, _indent_text(text)]
    return "\n".join(lines)


@cache  # shared by many methods
def _indent_text(text: str) -> str:
    return fill(text, DOCSTRING_WIDTH, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)


def _parameter_texts(row: Quantity) -> Iterator[tuple[str, str]]:
    own, names = row.takes.coordinates(row.takes.rates), row.takes.names(row.takes.rates + 2)
    if CLOSED in row.needs:
        yield "q : (..., n) or (..., N)", "Independent coordinates: rad or m; or all N of the tree, near the branch."
        if own > 1:
            yield f"{', '.join(names[1:own])} : (..., n)", "Their rates: per s, per s^2."
    else:
        text = COORDINATE_TEXTS.get(own, "Coordinates and their rates: rad or m, ...")
        yield f"{', '.join(names[:own])} : (..., n)", text
    if row.takes.motors:
        yield f"{', '.join(names[2:4])} : (..., n)", "Positions and velocities of the motors, but of rigid joints."
        yield f"{names[4]} : (..., n)", MOTORS[names[4]]
    if row.takes.forces:
        yield f"{names[own]} : (..., nv)", FORCES_TEXT
    if not row.gives.results:
        size = "nv" if row.takes.forces else "n"
        more = f"Further rates, each for one more time derivative of {row.names(0)[0]}."
        yield f"{', '.join(names[row.takes.rates :])}, *higher : (..., {size}), optional", more
    for name in list_options(row)[: -len(SHARED_OPTIONS)]:
        option = METHOD_OPTIONS[name]
        count = row.takes.wrench_rates - 1
        more = f", and {count} more: ({', '.join(rate_name('W', k) for k in range(count + 1))}) for it" if count else ""
        yield f"{name} : {option.takes}", option.text.format(more=more)
    yield f"{', '.join(SHARED_OPTIONS)} : optional", "See `Robot`."


def _returns(row: Quantity) -> tuple[str, str]:
    names, gives = ", ".join(row.names(0)), row.gives
    axes = [str(row.takes.rates) if axis == "rates" else AXIS_LENGTHS.get(str(axis), str(axis)) for axis in gives.shape]
    shape = _shape(axes)
    if gives.results:
        kind = shape
    elif row.of_bodies:
        kind = f"{shape}, or {_shape(axes[1:])} of one body; with rates a tuple of them"
    else:
        kind = f"{shape}, or tuple of {'them' if 'rates' in gives.shape else shape}"
    unit = f"Unit: {gives.unit}." if gives.results else f"Unit: {gives.unit}; of rates per s, per s^2, and so on."
    return f"{names} : {kind}", f"{unit} {row.printed.returns}".rstrip()


def _shape(axes: Sequence[str]) -> str:
    return f"({', '.join(['...', *axes])})" if axes else "(...)"


def _refusals(row: Quantity) -> list[str]:
    """What the method refuses besides what all methods refuse, which the docstring of `Robot` says."""
    when = [row.printed.raises] if row.printed.raises else []
    when += ["the robot has no closed loops", "its loops cannot be closed at q"] if CLOSED in row.needs else []
    when += ["the joints of the robot are rigid"] if ELASTIC in row.needs else []
    when += ["the base moves"] if row.takes.motors else []
    when += ["the mass matrix is singular at all positions"] if row.inverts else []
    return when


def _join_last(texts: Sequence[str]) -> str:
    return f"{', '.join(texts[:-1])}, or {texts[-1]}" if len(texts) > 2 else " or ".join(texts)
