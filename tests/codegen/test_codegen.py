"""Generated code is right by its own tests and by the recursion, in every language; bad requests are refused."""

import ctypes
import json
import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from importlib import metadata
from itertools import islice
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import sympy

import jounce
from jounce._codegen import generate, header, printer
from jounce._codegen.function import function_names, make_parametric, trace
from jounce._codegen.languages import LANGUAGE_NAMES, language
from jounce._codegen.options import CodegenOptions, plan_code
from jounce._codegen.test_vectors import vectors
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.dynamics.quantities.row import ELASTIC, Inputs, Outputs, Printed
from jounce.model.frame import Frame
from support.commands import call
from support.refusals import refusal
from support.robots import GOLDEN, floating, golden, on_its_axis, random_mechanism, springs
from support.several_named import named_robot
from support.tools import NODE, needs, require

STRICT = "-std=c99 -O0 -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wfloat-conversion -Werror"
STRICT_CXX = STRICT.replace("c99", "c++11"), STRICT.replace("c99", "c++17")
LANGUAGES = {  # the tools that a language takes, and what its Makefile is told
    "c": (["make", "gcc"], ["CC=gcc", f"CFLAGS={STRICT}"]),
    "casadi": (["make", "gcc"], ["CC=gcc", "CFLAGS=-O0 -Wall -Wextra -Wpedantic -Werror", f"PYTHON={sys.executable}"]),
    "cpp": (["make", "g++"], ["CXX=g++", f"CXXFLAGS={STRICT_CXX[0]}", "EIGEN="]),
    "cuda": (["make", "g++"], ["NVCC=", "CXX=g++", f"CXXFLAGS={STRICT_CXX[1]}"]),
    "javascript": (["make", NODE], [f"NODE={NODE}"]),
    "julia": (["make", "julia"], []),
    "latex": (["make", "pdflatex"], []),
    "matlab": (["make", "octave-cli"], []),
    "python": (["make"], [f"PYTHON={sys.executable}"]),
    "rust": (["make", "rustc"], ["RUSTFLAGS=-D warnings"]),
}
PANDA = Path(__file__).parents[2] / "examples" / "panda.urdf"
TALOS = [f for f in metadata.files("example-robot-data") or [] if f.name == "talos_full_v2.urdf"]
SYMBOLS = {name: sympy.Symbol(name) for name in ("L1", "L2", "m1", "m2", "g")}
DRIVES = {"armature": [0.3, 0.2], "damping": [0.5, 0.4], "friction": [2.0, 1.5], "eps": [0.5, 0.8]}


def driven_planar2r(terms):
    """The planar 2R with drive trains, these terms of them in Q."""
    m = jounce.load("planar2r").mechanism
    robot = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, drives=DRIVES, name="planar2r")
    return robot.with_drives(terms)


def stiffening(*springs):
    """The planar 2R on cubic springs (k, k3), some of which its forces deflect far beyond where they are linear."""
    laws = dict(zip(("joint1", "joint2"), (jounce.CubicSpring(*numbers) for numbers in springs), strict=True))
    return jounce.load("planar2r").elastic(spring=laws, rotor=0.1)


def standing_robot():
    """A floating robot on a point of a slope and on a plane."""
    robot = ROBOTS["floating"]()
    base, *_, tip = robot.body_names
    point = jounce.Contact(base, "point", place=(0.2, -0.1, 0.3), normal=(0.6, 0, 0.8))
    return robot.contacts([point, jounce.Contact(tip, "plane", place=(0.1, 0.2, 0))])


ROBOTS = {
    "iiwa14": lambda: jounce.load("iiwa14"),
    "panda": lambda: jounce.load(PANDA),
    "planar2r": lambda: jounce.load("planar2r", L1=1.1, L2=0.7, m1=2.0, m2=1.5),
    "symbols": lambda: jounce.load("planar2r", **SYMBOLS),
    "mixed5": lambda: jounce.Robot(golden("mixed5")[0]),
    "driven": lambda: driven_planar2r(True),
    "elastic": lambda: jounce.Robot(replace(driven_planar2r(True).mechanism, elasticity=springs(2))),
    "wound": lambda: jounce.load("planar2r").elastic(
        500.0, motors=jounce.Motor(gear=50, inertia=4e-5, friction=1e-3, resistance=0.5, inductance=2e-3, constant=0.1)
    ),
    "stiffening": lambda: stiffening((1e-3, 1e4), (1e2, 1e4)),
    "damped": lambda: driven_planar2r(["damping"]),
    "balanced": on_its_axis,
    "counter": lambda: counter_rotating(),
    "slide": lambda: slide_on_ground(),
    "several screws": named_robot,
    "several screws, floating": lambda: named_robot(floats=True),
    "odd symbols": lambda: jounce.load("planar2r", m1=1 + sum(map(sympy.Symbol, ODD_SYMBOLS.split()))),
    "odd names": lambda: oddly_named(),
    "floating": lambda: jounce.Robot(floating(golden("planar2r")[0], np.random.default_rng(1))),
    "standing": lambda: standing_robot(),
    "talos": lambda: jounce.load(Path(str(TALOS[0].locate()))),
    "mimic": lambda: jounce.Robot(
        random_mechanism(
            np.random.default_rng(5),
            [-1, 0, 0, -1],
            ["revolute", "prismatic", "helical", "revolute"],
            [1, 2, 3, 4],
            True,
        )
    ),
}


def every(body):
    """The spelling of every quantity of rigid robots, those of bodies of one, in every frame."""
    found = []
    for row in (row for row in QUANTITIES.values() if row.everywhere):
        places = [f":{body}:{frame}" for frame in row.gives.frames] or [f":{body}" if row.of_bodies else ""]
        found += [row.name + place for place in places]
    return tuple(found)


def in_equations(spelled):
    """Those of some quantities that LaTeX has: not what solves equations, nor tensors."""
    rows = [QUANTITIES[name.partition(":")[0]] for name in spelled]
    return tuple(name for name, row in zip(spelled, rows, strict=True) if not (row.takes.forces or row.gives.results))


ALL, PARAMETERS = every("body2"), ("gravity", "masses", "lengths", "payload", "payload:body1")
PRODUCTS = ("inverse_dynamics.vjp", "inverse_dynamics.jvp", "forward_dynamics.vjp", "base_wrench.jvp")
OF_MOTORS = tuple(row.name for row in QUANTITIES.values() if ELASTIC in row.needs)
STANDING = ("inverse_dynamics", "contact_wrenches", "inverse_dynamics.vjp", "inverse_dynamics.jvp")
FLOATING = ("inverse_dynamics", "jacobian:body1:world", "momentum.vjp")
APART = {"latex", "casadi"}  # no program; with Hessians, which take long to compile: test_codegen_casadi.py
PROGRAMS = [lang for lang in LANGUAGES if lang not in APART]
CASES = {  # the robot, what is asked for, how many states, and in which languages: in all what differs between them
    "iiwa14, order 0": ("iiwa14", {"order": 0, "outputs": ("inverse_dynamics", "mass_matrix")}, 20, "cpp python"),
    "iiwa14, order 1": ("iiwa14", {"order": 1, "wrench": True}, 20, "c cuda"),
    "iiwa14, order 2": ("iiwa14", {"order": 2}, 20, "all"),
    "iiwa14, order 2, single": ("iiwa14", {"order": 2, "wrench": True, "float32": True}, 20, "all"),
    "elastic, order 1": (
        "elastic", {"order": 1, "wrench": True, "outputs": ("motor_positions", "motor_torques")}, 20, "python",
    ),
    "elastic, all of motors": (
        "wound", {"order": 0, "wrench": True, "outputs": OF_MOTORS}, 20, "javascript python rust",
    ),
    "elastic, springs and rotors at run time": (
        "wound", {"order": 0, "wrench": True, "outputs": OF_MOTORS, "parameters": ("rotor", "stiffness")}, 20,
        "c cuda javascript matlab python rust",
    ),
    "elastic, all of motors, single": ("wound", {"order": 0, "float32": True, "outputs": OF_MOTORS}, 20, "c"),
    "stiffening springs": (
        "stiffening", {"order": 2, "outputs": ("motor_positions", "motor_torques")}, 20, "c cpp javascript python rust",
    ),
    "stiffening springs, single": (
        "stiffening", {"order": 0, "outputs": ("motor_positions",), "float32": True}, 20, "c python rust",
    ),
    "panda, order 0": ("panda", {"order": 0}, 20, "julia rust"),
    "panda, order 1": ("panda", {"order": 1, "parameters": ("gravity", "payload:panda_hand_tcp")}, 30, "cpp python"),
    "panda, order 2": ("panda", {"order": 2, "wrench": True}, 20, "c rust"),
    "panda, all": ("panda", {"order": 0, "wrench": True, "outputs": every("panda_hand_tcp")}, 10, "python"),
    "planar2r, all": ("planar2r", {"order": 2, "wrench": True, "outputs": ALL, "parameters": PARAMETERS}, 10, "all"),
    "planar2r, all, single": (
        "planar2r", {"order": 1, "outputs": ALL, "float32": True, "parameters": PARAMETERS}, 10, "all",
    ),
    "symbols": ("symbols", {"order": 2, "outputs": ("inverse_dynamics", "coriolis_matrix")}, 20, "cuda matlab python"),
    "mixed5": ("mixed5", {"order": 2, "wrench": True}, 20, "c rust"),
    "driven": ("driven", {"order": 2, "outputs": ("inverse_dynamics", "mass_matrix")}, 20, "all"),
    "driven, single": ("driven", {"order": 1, "float32": True}, 20, "all"),
    "products": ("planar2r", {"order": 1, "wrench": True, "outputs": PRODUCTS, "parameters": ("payload",)}, 9, "c"),
    "mimic": ("mimic", {"order": 0, "wrench": True, "outputs": ALL}, 10, "matlab python"),
    "floating": (
        "floating", {"order": 1, "wrench": True, "outputs": FLOATING, "parameters": ("masses", "payload:base")},
        6, "all",
    ),
    "standing": (
        "standing", {"order": 1, "wrench": True, "outputs": STANDING, "moving_base": True}, 6, "javascript python",
    ),
    "several screws": ("several screws", {"order": 0, "outputs": ("inverse_dynamics", "mass_matrix")}, 10, "all"),
    "several screws, derivatives": (
        "several screws", {"order": 1, "outputs": ("inverse_dynamics", "inverse_dynamics_partials", *PRODUCTS[:2])}, 10,
        "c python",
    ),
    "several screws, floating, single": (
        "several screws, floating", {"order": 0, "moving_base": True, "float32": True}, 6, "c python rust",
    ),
    "moving ground, single": ("planar2r", {"order": 1, "moving_base": True, "float32": True}, 6, "c python rust"),
}  # fmt: skip
languages = pytest.mark.parametrize("lang", [lang for lang in LANGUAGES if lang != "casadi"])
programs = pytest.mark.parametrize("lang", [pytest.param(x, marks=needs(*LANGUAGES[x][0])) for x in PROGRAMS])


@cache
def made_robot(name):
    return ROBOTS[name]()


def requested(
    robot, lang, order=2, outputs=("inverse_dynamics",), wrench=False, parameters=(), float32=False, moving_base=False
):
    """A request, checked."""
    options = CodegenOptions(
        lang=lang, order=order, outputs=outputs, wrench=wrench, parameters=parameters, float32=float32,
        moving_base=moving_base,
    )  # fmt: skip
    return plan_code(made_robot(robot), options)


@cache
def computed(robot, count, method, **options):
    """What all languages share: the functions of a request, and the test vectors of each."""
    request = requested(robot, "c", **options)
    functions = generate.trace_functions(request)
    return functions, [vectors(request.robot, f, request.single, count, method) for f in functions]


def texts(robot, lang, count=20, method="recursion", **options):
    """The files of generated code, its test vectors so many states by the recursion."""
    return generate.render_files(requested(robot, lang, **options), *computed(robot, count, method, **options))


def case_texts(name, lang):
    robot, options, count, _ = CASES[name]
    return texts(robot, lang, count, **options)


def write_files(folder, files):
    for name, text in files.items():
        (folder / name).write_text(text)
    return folder


def passes(folder, lang, *more):
    """What the test beside the code prints, and whether it passes."""
    tools, variables = LANGUAGES[lang]
    require(*tools)
    done = subprocess.run(["make", "-C", folder, "test", *variables, *more], capture_output=True, text=True)
    assert "warning" not in done.stderr
    return done.returncode == 0, done.stdout + done.stderr


def test_every_language_is_tested():
    assert set(LANGUAGES) == set(LANGUAGE_NAMES)


@pytest.mark.parametrize(
    ("name", "lang"),
    [
        pytest.param(name, lang, marks=needs(*LANGUAGES[lang][0]))
        for name, (*_, where) in CASES.items()
        for lang in PROGRAMS
        if where == "all" or lang in where.split()
        if language(lang).single or not CASES[name][1].get("float32")
    ],
)
def test_agrees_with_the_recursion(name, lang, tmp_path):
    passed, output = passes(write_files(tmp_path, case_texts(name, lang)), lang)
    assert passed, output
    _, options, count, _ = CASES[name]
    errors = re.findall(rf"worst relative error (\S+) over {count} states, allowed (\S+)", output)
    assert len(errors) == len(options.get("outputs", "1")), output
    assert {float(allowed) for _, allowed in errors} == {2e-4 if options.get("float32") else 1e-13}


@languages
@pytest.mark.parametrize(
    ("robot", "holds", "left"),
    [("driven", ["armature", "damping", "friction"], []), ("damped", ["damping"], ["armature", "friction"])],
)
def test_the_code_says_what_it_holds_of_drive_trains(lang, robot, holds, left):
    text = re.sub(r"\s[\s/*#%]*", " ", "".join(texts(robot, lang, count=1, order=0).values()))
    held = re.search(r"Q includes these terms of the drive trains: ([^.]*)\.", text)[1]
    assert re.findall("armature|damping|friction|spring", held) == holds
    without = re.search(r"terms of the robot's drive trains are omitted: ([^.]*)\.", text)
    assert (without[1].split(", ") if without else []) == left


@programs
def test_the_test_beside_the_code_proves_it(lang, tmp_path):
    """Written as users get it, it passes; with one constant of the code changed by a part in 10^9 it fails."""
    outputs = ["inverse_dynamics", "mass_matrix", "twists:body2:world"]
    made = made_robot("planar2r").codegen(lang, 1, tmp_path / "arm", outputs=outputs, wrench=True)
    passed, output = passes(made.directory, lang)
    assert passed, output
    assert output.count("10 states") == len(outputs)
    code = [tmp_path / "arm" / name for name in made.files if not name.startswith(("test", "README", "Makefile"))]
    changed = next(path for path in code if "37.7685" in path.read_text())  # (m1 + m2) g L1
    changed.write_text(re.sub(r"37\.7685\d*", "37.76850004", changed.read_text()))
    assert not passes(made.directory, lang)[0]


@pytest.mark.parametrize(
    "lang", [pytest.param(x, marks=needs(*LANGUAGES[x][0])) for x in ("c", "javascript", "python")]
)
def test_the_test_beside_the_code_knows_the_size_of_deflections(lang, tmp_path):
    """Written as users get it, with states whose forces deflect springs far beyond where they are linear."""
    robot = stiffening((1e2, 1e4), (1e-3, 1e4))
    made = robot.codegen(lang, 0, tmp_path / "arm", outputs=["motor_positions", "motor_torques"])
    passed, output = passes(made.directory, lang)
    assert passed, output


def test_the_head_says_that_forces_on_springs_are_of_links(tmp_path):
    arm = jounce.load("planar2r")
    for robot, said in ((arm, 0), (arm.elastic(800, rotor=0.1), 1)):
        made = robot.codegen("c", 0, tmp_path / f"c{said}", outputs=["inverse_dynamics", "mass_matrix"])
        head = re.sub(r"\s[\s*]*", " ", (made.directory / "planar2r.h").read_text())
        assert head.count("inverse_dynamics is that of the links; motor_torques is that of the motors.") == said


@programs
def test_what_is_zero_in_exact_arithmetic_is_no_false_alarm(lang, tmp_path):
    """The closed form gives noise for rates of the mass matrix and for gravity, the code gives 0 or other noise."""
    files = texts("balanced", lang, 10, "closed_form", outputs=every("body1"), wrench=True)
    passed, output = passes(write_files(tmp_path, files), lang)
    assert passed, output


def counter_rotating():
    """Two equal balls that turn about the same axis through their COMs, always against each other."""
    X, M = on_its_axis().mechanism.X[0], jounce.inertia_matrix(2.0, [0.1, 0.2, -0.4], 0.2 * np.eye(3))
    return jounce.Robot.from_screws([np.eye(4)] * 2, [X, X], [M, M], [-1, -1], G=[[1], [-1]], name="counter")


def test_momentum_that_cancels_is_no_false_alarm():
    q = np.array([[0.3], [0.4], [0.5], [0.6], [0.7]])
    assert max(np.abs(x).max() for x in made_robot("counter").momentum(*q)) < 1e-15
    files = texts("counter", "python", 10, "closed_form", outputs=every("body2"), wrench=True)
    assert passes_in_python(files["counter.py"], files["test_counter.py"])


def test_a_row_of_the_table_is_all_that_generated_code_takes(monkeypatch):
    """Here one with a law only, and no other field than those that every quantity has."""
    twists = QUANTITIES["twists"]
    speed = Quantity(
        name="speed",
        takes=Inputs(rates=2),
        gives=Outputs("s", twists.gives.shape, twists.gives.unit),
        laws={"recursion": twists.laws["recursion"]},
        printed=Printed(caption="speed", meaning=twists.printed.meaning, tex=twists.printed.tex),
    )
    monkeypatch.setitem(QUANTITIES, "speed", speed)
    files = texts("planar2r", "python", 10, "closed_form", outputs=("speed:body2",))
    assert "def speed_body2(q, qd, q2d, q3d):" in files["planar2r.py"]
    assert passes_in_python(files["planar2r.py"], files["test_planar2r.py"])


def test_the_head_says_of_which_body_and_in_which_frame_results_are():
    outputs = ("jacobian:panda_hand_tcp:world", "twists:panda_link7", "poses:panda_link0", "kinetic_energy")
    head = re.sub(r"\s[\s*]*", " ", texts("panda", "c", count=1, order=0, outputs=outputs)["panda.h"])
    for words in (
        "jacobian_panda_hand_tcp_world: body panda_hand_tcp, fixed on body panda_link7; components in inertial axes,",
        "twists_panda_link7: body panda_link7; components in the axes of the body, about its origin. ",
        "poses_panda_link0: body panda_link0, fixed on the ground. ",
        "entry (i, j) is J[8 i + j] and H[4 i + j]. Energies are arrays of one.",
        "void panda_kinetic_energy( const double q[8], const double qd[8], double T[1]);",
    ):
        assert words in head


def test_the_head_says_that_a_body_is_the_base():
    head = re.sub(r"\s[\s*]*", " ", texts("floating", "c", count=1, order=0, outputs=("jacobian:base",))["planar2r.h"])
    assert "jacobian_base: body base; components in the axes of the body, about its origin. " in head


def test_the_head_explains_positions_of_joints_of_several_screws():
    files = texts("several screws", "c", count=1, order=0, outputs=("inverse_dynamics", "inverse_dynamics.vjp"))
    head = re.sub(r"\s[\s*]*", " ", files["amid.h"])
    for words in (
        "Positions, the 18 entries of q: 0 hip, rad 1 ankle.qx, 1 2 ankle.qy, 1 3 ankle.qz, 1 4 ankle.qw, 1 5 toe, rad",
        "6 deck.x, m 7 deck.y, m 8 deck.cos, 1 9 deck.sin, 1 10 lid, rad 11 box.x, m",
        "Coordinates of the velocities, the 15 entries of qd, q2d, ... and of forces: 0 hip, rad 1 ankle.wx, rad",
        "5 deck.wz, rad 6 deck.vx, m 7 deck.vy, m 8 lid, rad",
        "Joints of several screws: ankle (ball), deck (planar), box (free). ",
        "are those by the 15 components of displacements",
        "const double q[18], const double qd[15], const double q2d[15], double Q[15]",
    ):
        assert words in head
    assert "Coordinates, the 15 entries" not in head
    text = texts("several screws", "python", count=1, order=0)["amid.py"]
    assert "q (..., 18), its rates (..., 15), wrenches (..., 6, 6)" in text


def test_test_vectors_hold_turns_of_several_lengths():
    _, [found] = computed("several screws", 10, "recursion", order=0)
    lengths = np.linalg.norm(found.inputs["q"][:, 1:5], axis=1), np.linalg.norm(found.inputs["q"][:, 8:10], axis=1)
    for x in lengths:
        assert x.min() >= 0.5 - 1e-12
        assert x.max() <= 2 + 1e-12
        assert np.ptp(x) > 0.1


def passes_in_python(text, test):
    """Whether generated Python passes the test beside it, in this process."""
    names = {"__name__": "test", "code": ModuleType("code")}
    exec(text, vars(names["code"]))
    exec(re.sub(r"^import \w+ as code$", "", test, flags=re.MULTILINE), names)
    return all(check() for name, check in names.items() if name.startswith("test_"))


STATEMENT = r"(?m)^    (?:t\d+|(?:sin|cos)\d+|\w+\[\d+\]) = .*$"
RESULT = r"(?m)^    \w+\[\d+\] = .*$"
SIGNS = {" + ": " - ", " - ": " + ", "np.sin": "np.cos", "np.cos": "np.sin"}


def with_changes(text, lines, pattern, change):
    """The text with one place of some lines changed, for each place."""
    for line in re.finditer(lines, text):
        for place in re.finditer(pattern, line[0]):
            start, end = (line.start() + k for k in place.span())
            yield text[:start] + change(place[0]) + text[end:]


@pytest.mark.parametrize(
    ("robot", "lines", "pattern", "change", "least"),
    [
        ("planar2r", STATEMENT, "|".join(map(re.escape, SIGNS)), SIGNS.get, 60),
        ("planar2r", STATEMENT, r"\d+\.\d+", lambda x: repr(float(x) + 1e-8), 50),
        ("balanced", RESULT, "$", lambda _: " + 1e-11", 8),
    ],
    ids=["signs", "numbers", "zeros"],
)
def test_any_single_change_of_the_code_fails_the_test_beside_it(robot, lines, pattern, change, least):
    some = tuple(name for name in ALL if "partials" not in name)  # some of which add zeros up, as the former do
    outputs = in_equations(some)[:4] if robot == "balanced" else some[:5]
    files = texts(robot, "python", 10, "closed_form", order=1, outputs=outputs, wrench=True)
    text, test = files[f"{robot}.py"], files[f"test_{robot}.py"]
    assert passes_in_python(text, test)
    mutants = list(with_changes(text, lines, pattern, change))
    assert len(mutants) >= least
    for mutant in mutants:
        assert not passes_in_python(mutant, test), set(mutant.splitlines()) - set(text.splitlines())


@programs
def test_long_programs_are_cut_into_parts_that_share_scratch_memory(lang, tmp_path, monkeypatch):
    monkeypatch.setattr(printer, "MAX_UNDIVIDED_STATEMENTS", 50)
    monkeypatch.setattr(printer, "STATEMENTS_PER_PART", 30)
    files = texts("mimic", lang, 20, order=1, outputs=ALL[:4], wrench=True, parameters=("payload:body3",))
    assert any("part5" in text for text in files.values())
    passed, output = passes(write_files(tmp_path, files), lang)
    assert passed, output


ODD_NAMES = ['*/ int x = "', "\n#error\\", "%} =# ]] ''' \"\"\" ", "ünï\u202e // \\"]


def oddly_named():
    m, joints = made_robot("mimic").mechanism, ODD_NAMES[::-1]
    return jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, names=ODD_NAMES, joint_names=joints, name="1 */ \n x")


@languages
def test_names_of_bodies_and_joints_never_leave_their_comments(lang, tmp_path):
    outputs = every(ODD_NAMES[1])
    files = texts("odd names", lang, 1, order=0, outputs=in_equations(outputs)[:6] if lang == "latex" else outputs)
    assert all(text.isascii() for text in files.values())
    passed, output = passes(write_files(tmp_path, files), lang)
    assert passed, output


class FromOne:
    """An array whose indices begin with one."""

    def __init__(self, array):
        self.array = array

    def __getitem__(self, index):
        return self.array[tuple(np.subtract(index, 1, dtype=int).reshape(-1))]

    def __setitem__(self, index, value):
        self.array[tuple(np.subtract(index, 1, dtype=int).reshape(-1))] = value


@pytest.mark.parametrize("name", ["iiwa14, order 2", "planar2r, all", "mimic", "floating"])
def test_statements_of_julia_are_right_where_there_is_no_julia(name, monkeypatch):
    """Python reads them as they are, given arrays that begin with one."""
    if name == "mimic":
        monkeypatch.setattr(printer, "MAX_UNDIVIDED_STATEMENTS", 50)
        monkeypatch.setattr(printer, "STATEMENTS_PER_PART", 30)
    robot, options, count, _ = CASES[name]
    text = next(text for file, text in case_texts(name, "julia").items() if file == f"{made_robot(robot).name}.jl")
    for function, expected in zip(*computed(robot, count, "recursion", **options), strict=True):
        bodies = re.findall(
            rf"^function {function.name}(?:_part\d+)?!.*?@inbounds begin\n(.*?)\n    end", text, re.M | re.S
        )
        code = compile(textwrap.dedent("\n".join(bodies)), name, "exec")
        for k, p in enumerate(islice(expected.parameter_sets(), 10)):
            arrays = {name: FromOne(x[k]) for name, x in expected.inputs.items()}
            arrays |= {x.name: FromOne(np.zeros(x.shape or 1)) for x in function.outputs} | {
                "scratch": FromOne(np.zeros(999))
            }
            parameters = {name: FromOne(x) if x.ndim else x for name, x in p.items()}
            exec(code, arrays | {"params": SimpleNamespace(**parameters), "sin": np.sin, "cos": np.cos})
            for x in function.outputs:
                error = np.abs(arrays[x.name].array - expected.outputs[x.name][k].reshape(x.shape or 1)).max()
                assert error <= 1e-13 * expected.scale(x.name)


@pytest.mark.parametrize("name", ["panda, order 0", "planar2r, all", "planar2r, all, single", "symbols", "floating"])
def test_julia_parses(name):
    tree_sitter = pytest.importorskip("tree_sitter")
    grammar = tree_sitter.Language(pytest.importorskip("tree_sitter_julia").language())
    for file, text in case_texts(name, "julia").items():
        if file.endswith(".jl"):
            assert not tree_sitter.Parser(grammar).parse(text.encode()).root_node.has_error, file


@pytest.mark.skipif(not TALOS, reason="no example-robot-data")
@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
def test_talos_takes_the_size_that_is_stated(tmp_path):
    [function], _ = computed("talos", 3, "recursion")
    assert function.operations < 17_000
    files = texts("talos", "c", 3)
    assert len(files["talos.c"]) < 450_000
    passed, output = passes(write_files(tmp_path, files), "c", "CFLAGS=-std=c99 -O0")
    assert passed, output


@pytest.mark.parametrize(("order", "operations"), [(0, 570), (1, 1240), (2, 2250)])
def test_the_head_states_the_operations_that_the_code_does(order, operations):
    files = texts("iiwa14", "c", count=1, order=order)
    (stated,) = re.findall(r"^/\* (\d+) operations:", files["iiwa14.h"], re.MULTILINE)
    body = files["iiwa14.c"].partition("\n{\n")[2]
    done = len(re.findall(r" [-+*] |\b(?:sin|cos)\(", body))
    assert done == int(stated) <= operations


def test_the_c_has_no_branches_no_globals_and_no_memory():
    options = {"order": 2, "outputs": ALL, "wrench": True, "parameters": PARAMETERS}
    code = texts("planar2r", "c", count=1, **options)["planar2r.c"]
    assert not re.findall(r"\b(if|for|while|do|switch|goto|malloc|static)\b|\?", code)
    assert re.findall(r"^\w.*;$", code, re.MULTILINE) == []  # nothing is declared outside of functions


@needs("make", "arm-none-eabi-gcc", "arm-none-eabi-nm")
@pytest.mark.parametrize("single", [False, True])
def test_what_the_c_takes_on_a_microcontroller(single, tmp_path):
    folder = write_files(tmp_path, texts("iiwa14", "c", count=1, float32=single))
    done = subprocess.run(["make", "-C", str(folder), "size"], capture_output=True, text=True, check=True)
    code, flash = (int(line.split()[0]) for line in done.stdout.splitlines() if ".arm." in line and "\t" in line)
    (stack,) = re.findall(r"iiwa14_inverse_dynamics\t(\d+)", done.stdout)
    assert code < 18_000
    assert flash < 22_000
    assert int(stack) < 2_000
    symbols = subprocess.run(["arm-none-eabi-nm", folder / "iiwa14.arm.o"], capture_output=True, text=True, check=True)
    needed = set(re.findall(r" U (\w+)", symbols.stdout))
    assert needed == ({"sinf", "cosf"} if single else {"sin", "cos"})


@needs("make", "clang")
def test_clang_warns_of_nothing(tmp_path):
    options = {"order": 1, "outputs": ALL, "wrench": True, "parameters": PARAMETERS, "float32": True}
    assert passes(write_files(tmp_path, texts("planar2r", "c", **options)), "c", "CC=clang")[0]


@languages
def test_generated_files_are_those_of_before(lang, tmp_path, request):
    """To the last byte; where they are to be others, `pytest --refresh-golden` writes their digests anew."""
    made = jounce.load("planar2r").codegen(lang, directory=tmp_path / lang)
    texts_of = {
        name: (tmp_path / lang / name).read_text().replace(jounce.__version__, "VERSION") for name in made.files
    }
    digests = "".join(f"{sha256(text.encode()).hexdigest()}  {name}\n" for name, text in sorted(texts_of.items()))
    golden_file = GOLDEN / "own_code" / f"{lang}.sha256"
    if request.config.getoption("--refresh-golden"):
        golden_file.parent.mkdir(exist_ok=True)
        golden_file.write_text(digests)
    assert golden_file.read_text() == digests


@languages
def test_texts_are_tidy_and_marked(lang):
    if lang == "latex":
        files = texts("planar2r", lang, 1, order=0, outputs=in_equations(ALL), parameters=PARAMETERS)
    else:
        files = case_texts("planar2r, all", lang)  # computed for its own test
    for name, text in files.items():
        assert header.GENERATED_MARK in "".join(text.splitlines(keepends=True)[:3]), name
        assert text.endswith("\n"), name
        assert not text.endswith("\n\n"), name
        assert not re.search(r"[ \t]+$", text, re.MULTILINE), name
        assert "\n\n\n\n" not in text, name


@pytest.mark.parametrize(("options", "words"), [
    ({"lang": "fortran"}, ["unknown language 'fortran'; available: c, "]),
    ({"lang": "pyton"}, ["did you mean 'python'?"]),
    ({"order": -1}, ["order is -1; expected 0 to 4"]),
    ({"order": 5}, ["order is 5"]),
    ({"outputs": ["massmatrix"]}, ["unknown quantity 'massmatrix'; did you mean 'mass_matrix'?", "inverse_dynamics, "]),
    ({"outputs": []}, ["outputs are []; expected one or more"]),
    ({"outputs": ["mass_matrix"], "wrench": True}, ["mass_matrix takes no wrenches"]),
    ({"parameters": ["mass"]}, ["unknown parameter 'mass'; did you mean 'masses'?"]),
    ({"prefix": "my arm"}, ["prefix 'my arm' is not a valid identifier"]),
    ({"prefix": "while"}, ["prefix 'while' is a reserved word of C99"]),
    ({"prefix": "_arm"}, ["prefix '_arm' is not"]),
    ({"prefix": 5}, ["prefix 5 is not"]),
    ({"prefix": "math"}, ["prefix 'math' is already a name in C99"]),
    ({"prefix": "j1", "lang": "cpp"}, ["prefix 'j1' is already a name in C++"]),
    ({"prefix": "typing", "lang": "python"}, ["prefix 'typing' is already a name in Python"]),
    ({"prefix": "check", "lang": "matlab"}, ["prefix 'check' is already a name in MATLAB"]),
    ({"prefix": "process", "lang": "javascript"}, ["prefix 'process' is already a name in JavaScript"]),
    ({"prefix": "Hd", "lang": "julia"}, ["prefix 'Hd' is already a name in Julia"]),
    ({"prefix": "a" * 47, "lang": "matlab"},
     ["makes identifiers of 64 characters; generated MATLAB allows at most 63"]),
    ({"prefix": "a" * 300}, ["aaa...' makes identifiers of 317 characters; generated C99 allows at most 200"]),
    ({"outputs": [["mass_matrix"]]}, ["unknown quantity ['mass_matrix'];"]),
    ({"outputs": None}, ["unknown quantity None; available: inverse_dynamics, "]),
    ({"outputs": ["mass_matrix", "poses"]}, ["poses of one body: expected poses:BODY; available: link1, link2"]),
    ({"outputs": "jacobian"}, ["expected jacobian:BODY, or jacobian:BODY:FRAME with a FRAME of body, world, spat"]),
    ({"outputs": ["jacobian::world"]}, ["holds jacobian of one body: expected jacobian:BODY, or jacobian:BODY:"]),
    ({"outputs": ["jacobian:link8:world"]}, ["unknown body 'link8'; did you mean 'link"]),
    ({"outputs": ["jacobian:link7:wold"]}, ["jacobian has no frame 'wold'; did you mean 'world'?"]),
    ({"outputs": ["momentum:link7"]}, ["momentum takes no body; these do: poses"]),
    ({"outputs": ["poses:link7", "poses:link7"]}, ["expected one or more different NAME[.PRODUCT][:BODY"]),
    ({"outputs": ["inverse_dynamics.hvp"]}, ["inverse_dynamics.hvp is not generated", "vjp, jvp"]),
    ({"outputs": ["mass_matrix.vjp"]},
     ["code of vjp is generated for vectors: inverse_dynamics", "not for mass_matrix"]),
    ({"outputs": ["twists:link7", "twists:link7:body"]}, ["expected one or more different NAME[.PRODUCT]"]),
    ({"outputs": ["poses:link7"], "wrench": True}, ["poses takes no wrenches; these do: inverse_dynamics, forward_"]),
    ({"parameters": "gravity"}, ["parameters are 'gravity'; expected a list of different names"]),
    ({"parameters": None}, ["parameters are None; expected a list"]),
    ({"wrench": "no"}, ["wrench is 'no'; expected True or False"]),
    ({"float32": 1}, ["float32 is 1; expected True or False"]),
    ({"directory": 5}, ["directory is 5; expected the path of a folder"]),
    ({"lang": "latex", "float32": True},
     ["LaTeX has no single precision", "c, cpp, cuda, julia, matlab, python, rust"]),
    ({"lang": "javascript", "float32": True}, ["JavaScript has no single precision; float32 works with c, cpp, "]),
    ({"lang": "latex"}, ["2213 operations; LaTeX is generated for up to 1200; larger robots go into c, casadi, "]),
], ids=lambda x: str(x) if isinstance(x, dict) else "")  # fmt: skip
def test_refusals(options, words, tmp_path):
    given = {"lang": "c", "directory": tmp_path / "new"} | options
    refusal(lambda: jounce.load("iiwa14").codegen(**given), *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("robot", "words"), [
    (lambda: jounce.load("planar2r", m1=sympy.Symbol("double")), ["parameter 'double' is a reserved word of C99"]),
    (lambda: jounce.load("planar2r", m1=sympy.Symbol("m 1")), ["parameter 'm 1' is not a valid identifier"]),
    (lambda: jounce.load("planar2r", m1=1 / sympy.Symbol("k")), ["the robot contains 1/k", "sums, products"]),
    (lambda: jounce.load("planar2r", m1=sympy.I * SYMBOLS["m1"]), ["the robot contains I", "real numbers"]),
    (lambda: jounce.load("planar2r", m1=sympy.zoo), ["code generation supports real numbers"]),
    (lambda: jounce.load("planar2r", m1=SYMBOLS["m1"], m2=sympy.Symbol("m1", positive=True)),
     ["the robot contains two symbols named m1"]),
    (lambda: jounce.Robot.from_screws([np.eye(4)] * 200, [[0, 0, 1, 0, 0, 0]] * 200, [np.eye(6)] * 200),
     ["robot has 200 bodies; code of order 2 is generated for at most 166"]),
])  # fmt: skip
def test_robots_that_cannot_be_written_are_refused(robot, words, tmp_path):
    refusal(lambda: robot().codegen("c", directory=tmp_path / "new"), *words)
    assert list(tmp_path.iterdir()) == []


def test_numbers_beyond_single_precision_are_refused(tmp_path):
    robot = jounce.load("planar2r", m1=1e39)
    assert robot.codegen("c", directory=tmp_path / "double").operations
    call = partial(robot.codegen, "c", directory=tmp_path / "single", float32=True)
    refusal(call, "the generated code would contain ", "e+39, which overflows float32")
    assert not (tmp_path / "single").exists()


def slide_on_ground():
    """A slide along x, and a link that is fixed on the ground."""
    m = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 0, 1, 0, 0]], [np.diag([1, 1, 1, 3.5, 3.5, 3.5])]).mechanism
    return jounce.Robot(replace(m, frames=(Frame("stand", -1, np.eye(4)),)))


@languages
def test_what_depends_on_nothing_is_written_too(lang, tmp_path):
    """A slide across gravity: Qgrav is zero, M constant, what stands on the ground is still; no argument is read."""
    outputs = ("gravity_forces", "mass_matrix", "poses:stand", "twists:stand:world", "jacobian:stand", "momentum")
    options = {"order": 1, "outputs": outputs, "parameters": ("lengths",)}
    passed, output = passes(write_files(tmp_path, texts("slide", lang, **options)), lang)
    assert passed, output


def test_what_depends_on_nothing_has_batch_axes_in_python():
    module, q = {}, np.zeros((4, 3, 1))
    exec(texts("slide", "python", 1, order=0, outputs=("mass_matrix", "poses:stand"))["robot.py"], module)
    assert module["mass_matrix"](q).shape == (4, 3, 1, 1)
    assert module["poses_stand"](q).shape == (4, 3, 4, 4)
    assert module["mass_matrix"](q[0, 0]).shape == (1, 1)


def test_too_many_operations_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr("jounce._codegen.options.language", lambda name: replace(language(name), largest=2000))
    refusal(lambda: jounce.load("iiwa14").codegen("c", directory=tmp_path / "new"), "2213 operations", "2000")


@pytest.mark.parametrize("name", [name for name in LANGUAGE_NAMES if language(name).reserved])
def test_words_of_the_language_are_refused_as_prefixes(name):
    word = "for"
    assert word in language(name).reserved.split()
    refusal(lambda: language(name).check_name(word, "prefix"), f"reserved word of {language(name).title}")


def test_symbols_are_parameters_by_their_names_without_clashes():
    robot = made_robot("symbols").mechanism
    assert list(make_parametric(robot, []).shapes) == sorted(SYMBOLS)
    one = jounce.load("planar2r", m1=sympy.Symbol("gravity")).mechanism
    refusal(lambda: make_parametric(one, ["gravity"]), "parameter 'gravity' is also the name of a symbol")
    two = jounce.load("planar2r", m2=SYMBOLS["m2"]).mechanism
    refusal(lambda: make_parametric(two, ["masses"]), "the mass of 'body2' is m2; 'masses' applies to numbers")


def test_symbols_that_parameters_replace_are_none_themselves():
    """Who set them would move nothing."""
    robot = jounce.load("planar2r", L2=SYMBOLS["L2"], g=SYMBOLS["g"]).mechanism
    assert list(make_parametric(robot, ["gravity", "masses", "lengths"]).shapes) == [
        "L2",
        "gravity",
        "masses",
        "lengths",
    ]


def test_powers_of_symbols_take_few_products():
    robots = (jounce.load("planar2r", m1=SYMBOLS["m1"] ** k).mechanism for k in (1, 3001))
    first, power = (trace(make_parametric(m, []), "", Computation("inverse_dynamics", 0)).operations for m in robots)
    assert power - first < 2 * np.log2(3001)


ODD_SYMBOLS = (
    "q qd Q M W p k j i t1 cos1 sin np x f scale found error worst passed larger scratch expected_Q STATES TOLERANCE"
)


@programs
def test_symbols_may_have_any_name(lang, tmp_path):
    """Those of the arguments and of what the code and its test call their own among them."""
    files = texts("odd symbols", lang, 10, order=0, outputs=ALL)
    passed, output = passes(write_files(tmp_path, files), lang)
    assert passed, output


@pytest.mark.parametrize(
    ("lang", "prefix"), [(x, y) for x in ("c", "cpp", "javascript", "python", "rust") for y in ("q", "k", "main_")]
)
def test_prefixes_may_be_names_of_arguments(lang, prefix, tmp_path):
    made = made_robot("planar2r").codegen(lang, 0, tmp_path / "arm", prefix=prefix)
    passed, output = passes(made.directory, lang)
    assert passed, output


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (4, 1)])
def test_the_python_refuses_arrays_of_another_shape(shape):
    module = {}
    exec(texts("planar2r", "python", 1, order=0, wrench=True)["planar2r.py"], module)
    q, W = np.zeros((4, 2)), np.zeros((4, 2, 6))
    assert module["inverse_dynamics"](q, q, q, W).shape == (4, 2)
    with pytest.raises(ValueError, match=r"expected \(2,\) behind any batch axes"):
        module["inverse_dynamics"](np.zeros(shape), q, q, W)
    with pytest.raises(ValueError, match=r"expected \(2, 6\) behind any batch axes"):
        module["inverse_dynamics"](q, q, q, np.zeros((*shape, 6)) if shape else q)


def test_functions_are_named_after_what_they_compute():
    def names(*bodies, frame="world", name="jacobian"):
        return function_names([Computation(name, 0, body=body, frame=frame) for body in bodies])

    assert names(None, name="mass_matrix", frame="body") == ["mass_matrix"]
    assert names("tool0", frame="body") == ["jacobian_tool0"]
    assert names("tool0") == ["jacobian_tool0_world"]
    assert names("base:joint 1", "a__b-", "ünï", "手") == [
        "jacobian_base_joint_1_world", "jacobian_a_b_world", "jacobian_n_world", "jacobian_world",
    ]  # fmt: skip
    assert names("a b", "a.b", "A_b", "a_b_world_2", "手", "手手") == [
        "jacobian_a_b_world", "jacobian_a_b_world_2", "jacobian_A_b_world_3", "jacobian_a_b_world_2_world",
        "jacobian_world", "jacobian_world_2",
    ]  # fmt: skip


def test_parameters_cost_nothing_where_there_are_none():
    plain = trace(make_parametric(jounce.load("iiwa14").mechanism, []), "", Computation("inverse_dynamics", 2))
    assert plain.operations <= 2213
    assert plain.parameters == ()


def test_the_help_names_all_languages():
    assert ", ".join(LANGUAGE_NAMES[:-1]) + f" or {LANGUAGE_NAMES[-1]}." in " ".join(
        call("codegen", "--help").output.split()
    )


def test_the_help_names_every_quantity_as_it_is_spelled():
    words = call("help", "quantities").output.replace(",", " ").split()
    for row in QUANTITIES.values():
        assert row.name + (":BODY" if row.of_bodies else "") + ("[:FRAME]" if row.gives.frames else "") in words


def test_the_verb_writes_what_the_function_does(tmp_path):
    options = [
        "--order",
        1,
        "--outputs",
        "inverse_dynamics,mass_matrix",
        "--wrench",
        "--parameters",
        "gravity, payload",
    ]
    done = call(
        "codegen",
        "planar2r",
        "--lang",
        "c",
        *options,
        "--float32",
        "--prefix",
        "arm",
        "-o",
        tmp_path / "verb",
        "--json",
    )
    made = jounce.load("planar2r").codegen(
        "c", 1, tmp_path / "function", outputs=["inverse_dynamics", "mass_matrix"],
        wrench=True, parameters=["gravity", "payload"], float32=True, prefix="arm",
    )  # fmt: skip
    summary = json.loads(done.output)
    assert summary["operations"] == made.operations
    assert tuple(summary["files"]) == made.files == ("Makefile", "README.md", "arm.c", "arm.h", "test_arm.c")
    for name in made.files:
        assert (tmp_path / "verb" / name).read_text() == (made.directory / name).read_text()


@needs("gcc")
def test_springs_and_rotors_at_run_time_are_those_of_another_arm(tmp_path):
    """C code of one arm, called with the numbers of another one, against this one in NumPy."""
    outputs = ["motor_commands", "motor_torques", "feedback_linearization", "elastic_forward_dynamics"]
    arm = jounce.load("panda_elastic")
    arm.codegen("c", 0, tmp_path, outputs=outputs, parameters=["stiffness", "rotor"], prefix="arm", overwrite=True)
    library = tmp_path / "arm.so"
    subprocess.run(["gcc", "-std=c99", "-O1", "-shared", "-fPIC", "-o", library, tmp_path / "arm.c", "-lm"], check=True)
    code, rng = ctypes.CDLL(str(library)), np.random.default_rng(3)
    stiffness, rotor = arm.elasticity.stiffness * rng.uniform(0.3, 3, 7), arm.elasticity.rotor * rng.uniform(0.3, 3, 7)
    other, state = arm.elastic(stiffness, rotor=rotor), rng.uniform(-1, 1, (5, 7))
    numbers = np.concatenate([stiffness, rotor])
    for name in outputs:
        expected = getattr(other, name)(*state)
        expected = expected if isinstance(expected, tuple) else (expected,)
        found = [np.empty(7) for _ in expected]
        getattr(code, f"arm_{name}")(*(ctypes.c_void_p(x.ctypes.data) for x in (*state, numbers, *found)))
        for x, right in zip(found, expected, strict=True):
            np.testing.assert_allclose(x, right, rtol=0, atol=1e-11 * np.abs(right).max())
        own = getattr(arm, name)(*state)
        assert not np.allclose(found[-1], own[-1] if isinstance(own, tuple) else own, rtol=1e-3)


def test_springs_and_rotors_are_parameters_of_elastic_joints_alone():
    def parameters(robot, *names):
        return lambda: make_parametric(robot.mechanism, names)

    robot = jounce.load("planar2r")
    refusal(parameters(robot, "rotor"), "parameter 'rotor': the joints of 'planar2r' are rigid; robot.elastic(")
    for arm in (robot.elastic({"joint1": 5.0}, rotor=1.0), stiffening((9.0, 0.0), (9.0, 1.0))):
        refusal(parameters(arm, "stiffness"), "parameter 'stiffness': joint '", "has no linear spring")
        assert list(make_parametric(arm.mechanism, ["rotor"]).shapes) == ["rotor"]
    half = robot.elastic({"joint1": 5.0}, rotor=[1.0, 2.0])
    options = CodegenOptions(lang="c", order=0, outputs=["elastic_forward_dynamics"], parameters=["rotor"])
    [function] = generate.trace_functions(plan_code(half, options))
    assert function.parameters[0].size == 2
    assert header.elastic_joints(half.mechanism, [function])


def test_parameters_without_effect_are_warned_of(tmp_path):
    given = {"outputs": ["mass_matrix", "poses:body2"], "parameters": ["gravity", "lengths"]}
    with pytest.warns(jounce.JounceWarning, match="^parameters without effect on mass_matrix, poses_body2: gravity$"):
        jounce.load("planar2r").codegen("c", 0, tmp_path / "code", **given)


@pytest.mark.parametrize("lang", LANGUAGES)
def test_overwrite_leaves_no_file_of_another_robot_or_output(lang, tmp_path):
    folder = tmp_path / "code"
    robot = jounce.load("planar2r")
    robot.codegen(lang, 0, folder, parameters=["masses"], prefix="old", outputs=["momentum", "gravity_forces"])
    (folder / "mine.txt").write_text("mine")
    made = robot.codegen(lang, 0, folder, prefix="second", overwrite=True)
    assert sorted(path.name for path in folder.iterdir()) == sorted([*made.files, "mine.txt"])


def test_the_verb_says_what_it_wrote_and_refuses_in_one_line(tmp_path):
    done = call("codegen", "planar2r", "--lang", "c", "-o", tmp_path / "arm")
    assert done.output.splitlines() == [
        "planar2r_inverse_dynamics: 100 operations",
        f"Makefile, README.md, planar2r.c, planar2r.h, test_planar2r.c written to {tmp_path / 'arm'}",
    ]
    again = call("codegen", "planar2r", "--lang", "c", "-o", tmp_path / "arm")
    assert again.exit_code == 2
    assert "is not empty" in again.output
    assert len(again.output.splitlines()) == 1
    assert (
        call("codegen", "planar2r", "--lang", "c", "--order", 0, "-o", tmp_path / "arm", "--overwrite").exit_code == 0
    )
    assert "order 0" in (tmp_path / "arm" / "planar2r.h").read_text()
