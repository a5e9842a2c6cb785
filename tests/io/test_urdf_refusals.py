"""Files that are no robot: each refused in one line that names the file, the line, what came and what there is."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import jounce
from support.files import BODY, GOOD, LINKS, MOMENTS, joint, link, robot_file, text
from support.refusals import refusal


def turn(**given):
    return (*LINKS, joint("turn", "base", "arm", **given))


def turned(*ends):
    return (*LINKS, joint("turn", *ends))


def mimic(name):
    return f'<mimic joint="{name}"/>'


def inertial(inner):
    return (*GOOD, link("x", inner=f"<inertial>{inner}</inertial>"))


def fixed(inner):
    return (*GOOD, f'<joint name="x" type="fixed">{inner}</joint>')


MOMENTS_OF_ONE = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
LOOP = (link("a"), link("b"), joint("one", "a", "b"), joint("two", "b", "a"))
CIRCLE = (link("c"), link("d"), joint("x", "arm", "c", inner=mimic("y")), joint("y", "arm", "d", inner=mimic("x")))
REFUSED = {
    "cycle without root": (LOOP, [":4", "no root", "one, two", "cycle", "tree"]),
    "cycle beside a root": ((*GOOD, *LOOP), ["one, two", "cycle", "tree"]),
    "line break in joints of a cycle": ((link("a"), joint("j&#10;k", "a", "a")), ["cycle"]),
    "line break in known names": ((link("a&#10;b"), joint("j", "a", "a")), [":3", "'a'"]),
    "two parents": ((*GOOD, link("top"), joint("grip", "top", "arm")), [":6", "'arm'", "'turn' and 'grip'"]),
    "floating joint": ((*turn(kind="floating"), link("hand"), joint("bend", "arm", "hand")),
        [":4", "'turn'", "floating", "base='fixed'", "root="]),
    "misspelt joint type": (turn(kind="revolut"), [":4", "did you mean 'revolute'"]),
    "zero axis": (turn(axis="0 0 -0.0"), [":4", "'turn'", "zero axis"]),
    "absent parent": (turned("bass", "arm"), [":4", "parent", "'turn'", "did you mean 'base'", "base, arm"]),
    "absent child": (turned("base", "hand"), [":4", "child", "'turn'", "'hand'", "base, arm"]),
    "mimic of nothing": (turn(inner=mimic("trun")), [":4", "'trun'", "did you mean 'turn'"]),
    "mimic of itself": (turn(inner=mimic("turn")), [":4", "turn -> turn"]),
    "mimic in a circle": ((*GOOD, *CIRCLE), [":7", "cycle", "x -> y -> x"]),
    "mimic of a fixed joint": ((*turn(inner=mimic("glue")), link("tool"), joint("glue", "arm", "tool", "fixed")),
        [":4", "'turn'", "'glue'", "fixed"]),
    "mimic without leader": (turn(inner="<mimic/>"), [":4", "<mimic>", "joint="]),
    "no movable joint": (turn(kind="fixed"), ["no movable joint"]),
    "no joint": (LINKS, ["no movable joint"]),
    "two links of one name": ((*GOOD, link("arm")), [":5", "link", "'arm'", ":3"]),
    "two joints of one name": ((*GOOD, link("x"), joint("turn", "arm", "x")), [":6", "joint", "'turn'", ":4"]),
    "nameless link": ((*GOOD, "<link/>"), [":5", "<link>", "name="]),
    "empty name": ((*GOOD, link("")), [":5", "<link>", "name="]),
    "nameless joint": ((*GOOD, '<joint type="fixed"/>'), [":5", "<joint>", "name="]),
    "joint without type": ((*GOOD, '<joint name="x"/>'), [":5", "<joint>", "type="]),
    "joint without parent": (fixed('<child link="arm"/>'), [":5", "'x'", "<parent>"]),
    "joint without child": (fixed('<parent link="arm"/>'), [":5", "'x'", "<child>"]),
    "parent without link": (fixed('<parent/><child link="arm"/>'), [":5", "<parent>", "link="]),
    "inertial without mass": (inertial('<inertia ixx="1"/>'), [":5", "<mass>"]),
    "inertial without inertia": (inertial('<mass value="1"/>'), [":5", "<inertia>"]),
    "mass without value": (inertial("<mass/><inertia/>"), [":5", "<mass>", "value="]),
    "inertia without moments": (inertial('<mass value="1"/><inertia ixx="1"/>'), [":5", "<inertia>", "ixy="]),
    "inertia too large": (inertial('<origin xyz="1e300 0 0"/><mass value="1e300"/>' + MOMENTS_OF_ONE),
        [":5", "inertia of link 'x' holds inf", "finite"]),
    "frame of an inertial": (inertial('<origin xyz="0 0 1" frame="arm"/><mass value="1"/>' + MOMENTS_OF_ONE),
        [":5", "unknown attribute of <origin> 'frame'", "xyz, rpy"]),
    "orientation that would be lost": (turn(inner='<origin quat_xyzw="0 0 1 0"/>'), [":4", "'quat_xyzw'", "xyz, rpy"]),
    "xacro expression": (inertial('<mass value="${m}"/><inertia/>'), [":5", "${m}"]),
}  # fmt: skip


@pytest.mark.parametrize(("items", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(tmp_path, items, words):
    path = robot_file(tmp_path, *items)
    refusal(lambda: jounce.load(path), str(path), *words)


TURN = {
    "xyz": {"inner": '<origin xyz="@"/>'},
    "rpy": {"inner": '<origin xyz="0 0 0" rpy="@"/>'},
    "axis": {"axis": "@"},
    "multiplier": {"inner": '<mimic joint="turn" multiplier="@"/>'},
    "offset": {"inner": '<mimic joint="turn" offset="@"/>'},
}
ARM = {"COM": text(BODY[1]), "COM rpy": text(BODY[2]), "mass": "2.0"}
ARM |= {key: f"{value!r}" for key, value in zip(MOMENTS, BODY[3], strict=True)}
NUMBERS = {
    **{what: turn(**given)[2] for what, given in TURN.items()},
    **{what: link("x", BODY).replace(f'"{given}"', '"@"') for what, given in ARM.items()},
}


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
def test_large_numbers_are_read_without_overflow_warnings(tmp_path):
    broad = [link(name, (1.0, [0, 0, 0], [0, 0, 0], [1e308, 0.0, 0.0, 1e308, 0.0, 1e308])) for name in ("x", "y")]
    path = robot_file(tmp_path, *GOOD, *broad, joint("lift", "arm", "x"), joint("bend", "x", "y"))
    assert jounce.load(path).mechanism.M.max() == 1e308
    refusal(lambda: jounce.load(path, lock={"bend": 0.5}), str(path), "locking bend overflows")


@pytest.mark.parametrize(("what", "item"), NUMBERS.items(), ids=NUMBERS)
@pytest.mark.parametrize("bad", ["one", "nan", "inf", "-1e999", "", "1,2,3", "1_0", "0x10", "1 2", "1 2 3 4"])
def test_refuses_numbers(tmp_path, what, item, bad):
    count = 3 if what in ("xyz", "rpy", "axis", "COM", "COM rpy") else 1
    came = bad if len(bad.split()) != 1 else " ".join([bad, *["0"] * (count - 1)])  # one bad number among good ones
    assert item.count("@") == 1
    path = robot_file(tmp_path, *LINKS, item.replace("@", came))
    refusal(lambda: jounce.load(path), f"{path}:4", f"{came!r}", f"{count} finite number")


@pytest.mark.parametrize(
    "uri", ["http://www.ros.org/wiki/xacro", "http://ros.org/wiki/xacro", "http://wiki.ros.org/xacro"]
)
def test_refuses_xacro(tmp_path, uri):
    head = f'<robot name="r" xmlns:xacro="{uri}">'
    path = robot_file(tmp_path, *GOOD, '<xacro:include filename="rest.xacro"/>', head=head)
    refusal(lambda: jounce.load(path), f"{path}:5", "xacro")
    jounce.load(robot_file(tmp_path, *GOOD, head=head))  # what xacro writes still declares its namespace


FILES = {
    "empty": (b"", ["not XML", "empty"]),
    "blank": (b" \n\n", ["not XML"]),
    "text": (b"robot", ["not XML", "line 1"]),
    "binary": (bytes(range(256)) * 9, ["not XML"]),
    "unclosed": (b"<robot>\n<link name='a'>\n</robot>", ["not XML", "link", "line 3"]),
    "unknown encoding": (b"<?xml version='1.0' encoding='klingon'?><robot/>", ["klingon"]),
    "another format": (b"<sdf version='1.6'/>", ["<sdf>", "<robot>"]),
    "nothing in it": (b"<robot name='r'/>", ["no movable joint"]),
}


@pytest.mark.parametrize(("content", "words"), FILES.values(), ids=FILES)
def test_refuses_files(tmp_path, content, words):
    path = tmp_path / "robot.urdf"
    path.write_bytes(content)
    refusal(lambda: jounce.load(path), str(path), *words)


def test_names_no_file_but_the_user_s(tmp_path):
    path = robot_file(tmp_path, "<link>")
    assert "<string>" not in refusal(lambda: jounce.load(path), str(path))  # lxml's name for the text it parses


SOURCES = {
    **{f"absent {name}": (name, [f"^{name}: no such file"])
       for name in ("absent.urdf", "absent.urdf.xacro", "absent.xml", "absent.yaml", "absent.json")},
    "near a bundled one": ("iiwa15", ["'iiwa15'", "did you mean 'iiwa14'", "planar2r", ".urdf"]),
    "bare name": ("robot", ["'robot'", "iiwa14, planar2r", ".urdf"]),
    "other suffix": ("robot.stl", ["robot.stl", "'.stl'", ".urdf"]),
    "long name": ("x" * 300, ["xxx"]),
    "long file name": ("x" * 300 + ".urdf", ["xxx"]),
}  # fmt: skip


@pytest.mark.parametrize("kind", [str, Path])
@pytest.mark.parametrize(("source", "words"), SOURCES.values(), ids=SOURCES)
def test_refuses_sources(source, words, kind):
    refusal(lambda: jounce.load(kind(source)), *words)


def test_refuses_a_directory(tmp_path):
    path = tmp_path / "robot.urdf"
    path.mkdir()
    assert "no such file" not in refusal(lambda: jounce.load(path), str(path))  # it exists


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_refuses_an_unreadable_file(tmp_path):
    path = robot_file(tmp_path, *GOOD)
    path.chmod(0)
    refusal(lambda: jounce.load(path), str(path), "cannot be read")


@pytest.mark.parametrize("root", [3, ["base"], ("base",)])
def test_refuses_roots_that_are_no_names(tmp_path, root):
    refusal(lambda: jounce.load(robot_file(tmp_path, *GOOD), root=root), "unknown link", "base, arm")


def test_gravity_none_is_that_of_a_file_without_any(tmp_path):
    assert jounce.load(robot_file(tmp_path, *GOOD), gravity=None).gravity.tolist() == [0, 0, -9.81]


@pytest.mark.parametrize("source", ["planar2r", "iiwa14", "file"])
@pytest.mark.parametrize("name", ["gravty", "path"])
def test_refuses_parameters(tmp_path, source, name):
    source = robot_file(tmp_path, *GOOD) if source == "file" else source
    refusal(lambda: jounce.load(source, **{name: 1}), f"'{name}'", "available: ")


WHERE = {
    "text": "<robot name='r'>&x;",
    "text of an element": "<robot name='r'><link name='a'>&x;</link>",
    "attribute": "<robot name='r'><link name='&x;'/>",
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize("declared", ['[<!ENTITY x SYSTEM "{}">]', 'SYSTEM "{}"', '[<!ENTITY % p SYSTEM "{}"> %p;]'])
@pytest.mark.parametrize("head", WHERE.values(), ids=WHERE)
def test_external_entities_are_never_opened(tmp_path, declared, head):
    """Neither shown, nor read: a pipe without a writer would hold its reader for good."""
    secret, pipe = tmp_path / "secret.txt", tmp_path / "pipe"
    secret.write_text("TOKEN")
    os.mkfifo(pipe)
    code = "import jounce, sys\nfor file in sys.argv[1:]:\n try: print(jounce.load(file))\n"
    code += " except jounce.JounceError as error: print(error)"
    head = f"<!DOCTYPE robot {declared}>\n{head}"
    paths = [
        robot_file(tmp_path, *GOOD, head=head.format(to.as_uri()), name=f"{to.stem}.urdf") for to in (secret, pipe)
    ]
    done = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, timeout=120, check=True)
    assert "TOKEN" not in done.stdout + done.stderr


LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))


@pytest.mark.parametrize(
    "place", ["&l11;", "<link name='&l11;'/>", "<gazebo a='&l11;'/>", "<link name='a'>&l11;</link>"]
)
def test_a_billion_laughs_end_quickly(tmp_path, place):
    path = robot_file(tmp_path, *GOOD, place, head=f'<!DOCTYPE robot [<!ENTITY l0 "laugh">{LAUGHS}]>\n<robot>')
    start = time.perf_counter()
    refusal(lambda: jounce.load(path), str(path), "ntit")
    assert time.perf_counter() - start < 2


def test_content_behind_an_entity_is_not_lost_silently(tmp_path):
    """Entities stay unresolved, so that a link whose inertia stands in one would weigh nothing."""
    head = "<!DOCTYPE robot [<!ENTITY heavy \"<inertial><mass value='9'/><inertia/></inertial>\">]>\n<robot>"
    path = robot_file(tmp_path, LINKS[0], link("arm", inner="&heavy;"), joint("turn", "base", "arm"), head=head)
    refusal(lambda: jounce.load(path), str(path), "ntit")


DECLARED = {
    "entity": '[<!ENTITY heavy "9">]',
    "default attribute": '[<!ATTLIST mass value CDATA "9">]',
    "nothing": "[]",
    "parameter": '[<!ENTITY % p SYSTEM "p.dtd"> %p;]',
    "elsewhere": 'SYSTEM "robot.dtd"',
}
MASS = '<inertial><mass/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.mark.parametrize("suffix", ["urdf", "xml", "xacro"])
@pytest.mark.parametrize("declared", DECLARED.values(), ids=DECLARED)
def test_a_document_type_that_declares_anything_is_refused_as_a_whole(tmp_path, declared, suffix):
    """Else the mass of the arm would be 9 kg for one reader and none for another."""
    items = (LINKS[0], link("arm", inner=MASS), joint("turn", "base", "arm"))
    head = f"<?xml version='1.0'?>\n<!DOCTYPE robot {declared}>\n<robot name='r'>"
    path = robot_file(tmp_path, *items, head=head, name=f"robot.{suffix}")
    message = refusal(lambda: jounce.load(path), f"{path}:2: the document type", "entities", "default attribute")
    assert message.startswith(str(path))


def test_so_are_those_of_included_files(tmp_path):
    head = f"<!DOCTYPE robot {DECLARED['default attribute']}>\n<robot>"
    robot_file(tmp_path, link("arm", inner=MASS), joint("turn", "base", "arm"), head=head, name="arm.xacro")
    path = robot_file(
        tmp_path, LINKS[0], '<xacro:include filename="arm.xacro"/>', name="robot.xacro",
        head='<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">',
    )  # fmt: skip
    refusal(lambda: jounce.load(path), str(path), "arm.xacro:1: the document type")


def test_mjcf_is_no_exception(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text('<!DOCTYPE mujoco [<!ENTITY m "9">]>\n<mujoco/>')
    refusal(lambda: jounce.load(path), f"{path}:1: the document type")


@pytest.mark.parametrize("suffix", ["urdf", "xml", "xacro"])
def test_a_document_type_alone_does_no_harm(tmp_path, suffix):
    path = robot_file(tmp_path, *GOOD, head="<!DOCTYPE robot>\n<robot name='r'>", name=f"robot.{suffix}")
    assert jounce.load(path).joint_names == ("turn",)
