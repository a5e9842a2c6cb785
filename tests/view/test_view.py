"""The live view shows what jounce computes: poses, Q and wrenches, along a motion and where sliders say."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from http.client import HTTPConnection
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jounce
from jounce._report import scene, viewer
from jounce._report.drawing import LINK
from jounce._report.scene import MAX_TRACK_STATES, record_track, rest_state
from jounce.cli import pages
from jounce.io.visuals import NO_FILE, OUTSIDE, _folder_resolver, find_mesh, read_mesh, read_visuals, robot_visuals
from support.commands import call, run
from support.files import BODY, joint, link, origin, robot_file
from support.refusals import refusal
from support.robots import floating

trimesh = pytest.importorskip("trimesh")
rich = pytest.importorskip("rich")
viser = pytest.importorskip("viser")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ARM = jounce.load("planar2r").with_limits(effort=[25.0, np.inf], lower=[-1.95, -np.inf], upper=[1.95, np.inf])
MOTION = """
time: {start: 1, stop: 3, count: 9000}
joints:
  joint1: {cosines: [{amplitude: 2, frequency: 3}]}
  joint2: {cosines: [{amplitude: 1, frequency: 5}]}
wrenches:
  body2: {fx: {offset: 3, cosines: [{amplitude: 1, frequency: 4}]}, fy: {offset: -4}, mz: {offset: 1}}
"""


@pytest.fixture(scope="module")
def motion_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("motion") / "motion.yaml"
    path.write_text(MOTION)
    return path


@pytest.fixture(scope="module")
def loaded_motion(motion_file):
    return jounce.load_motion(motion_file, ARM)


@pytest.fixture(scope="module")
def recorded_track(loaded_motion):
    return record_track(ARM, loaded_motion)


@pytest.fixture(scope="module")
def served_view(recorded_track):
    with viewer.serve_robot(ARM, Path("planar2r"), recorded_track, 0) as found:
        yield found


def shown_poses(served):
    found = np.tile(np.eye(4), (2, 1, 1))
    for C, body in zip(found, served.scene.bodies, strict=True):
        C[:3, :3], C[:3, 3] = Rotation.from_quat(np.roll(body.wxyz, -1)).as_matrix(), body.position
    return found


def shown_force(served, name):
    """Where an arrow begins, and its force or moment."""
    [[start, end]] = served.scene.arrows[name].points
    kind = "moment" if name == "base moment" else "force"
    return start, (end - start) / (scene.ARROW_LENGTH * served.scene.size) * served.scene.largest[kind]


def test_the_page_is_served_to_this_machine(served_view):
    assert served_view.address.startswith("http://127.0.0.1:")
    with urlopen(served_view.address, timeout=20) as page:
        assert b"<!doctype html>" in page.read()[:100].lower()


@pytest.mark.parametrize(
    ("origin", "host", "status"),
    [
        (None, "127.0.0.1", 101),
        ("http://127.0.0.1", "127.0.0.1", 101),
        ("http://localhost", "localhost", 101),
        ("http://site.example", "127.0.0.1", 403),
        ("https://127.0.0.1", "127.0.0.1", 403),
        ("http://127.0.0.1:1", "127.0.0.1", 403),
        ("null", "127.0.0.1", 403),
        ("http://site.example", "site.example", 403),
        (None, "site.example", 403),
    ],
)
def test_websockets_are_for_the_page_of_this_server(served_view, origin, host, status):
    """A browser lets any page connect to this machine, under any name that leads here, and states its origin."""
    port = served_view.server.get_port()
    origin = f"{origin}:{port}" if origin == f"http://{host}" else origin
    key = {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version": "13"}
    key["Sec-WebSocket-Protocol"] = f"viser-v{viser.__version__}"  # the server prints a line about others
    headers = {"Host": f"{host}:{port}", "Connection": "Upgrade", "Upgrade": "websocket"} | key
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", "/", headers=headers | ({"Origin": origin} if origin else {}))
    assert connection.getresponse().status == status
    connection.close()


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        ("http://127.0.0.1:80", "127.0.0.1:8080"),
        ("http://127.0.0.1:80801", "127.0.0.1:8080"),
        ("http://127.0.0.1:8080.site.example", "127.0.0.1:8080"),
        ("http://127.0.0.1:8080@site.example", "127.0.0.1:8080"),
        ("http://site.example/http://127.0.0.1:8080", "127.0.0.1:8080"),
        ("http", "127.0.0.1:8080"),
        ("", "127.0.0.1:8080"),
        ("http://localhost.site.example:8080", "localhost.site.example:8080"),
        (None, "notlocalhost:8080"),
        (None, "127.0.0.1.site.example"),
        (None, "local"),
        (None, ""),
    ],
)
def test_origins_and_hosts_are_compared_as_a_whole(origin, host):
    """One that begins or ends as this server's is that of another page."""
    assert viewer.refusal({"Host": host} | ({} if origin is None else {"Origin": origin})) is not None


def test_start_and_stop_print_nothing_and_leave_stdout_alone(recorded_track, capfd):
    stdout = sys.stdout

    def start(_):
        with viewer.serve_robot(ARM, Path("planar2r"), None, 0):
            return sys.stdout is stdout

    with ThreadPoolExecutor(2) as threads:
        assert all(threads.map(start, range(4)))
    assert sys.stdout is stdout
    assert capfd.readouterr().out == ""
    assert not rich.get_console().quiet


@pytest.mark.parametrize("t", [1.0, 1.7, 3.0])
def test_at_a_time_of_the_motion_all_is_shown(served_view, recorded_track, loaded_motion, t):
    served_view.time.value = 2.0
    served_view.time.value = t
    now = recorded_track.at(t)
    assert abs(now.t - t) < 2 / MAX_TRACK_STATES
    q, qd, q2d = loaded_motion(float(now.t), 2)
    W = loaded_motion.wrench(float(now.t), 0)[0]
    C, Q, F = ARM.poses(q), ARM.inverse_dynamics(q, qd, q2d, wrench=W), ARM.base_wrench(q, qd, q2d, wrench=W)
    np.testing.assert_allclose([slider.value for slider in served_view.joints], q, atol=1e-12)
    np.testing.assert_allclose(shown_poses(served_view), C, atol=1e-12)
    for name, start, force in (
        ("base moment", np.zeros(3), F[:3]),
        ("base force", np.zeros(3), F[3:]),
        ("load 0", C[1, :3, 3], -C[1, :3, :3] @ W["body2"][3:]),  # on the body
    ):
        np.testing.assert_allclose(shown_force(served_view, name), [start, force], atol=1e-4)  # single precision
    for j, name in enumerate(ARM.joint_names):
        assert f"<td>{name}</td><td>{Q[j]:.4g} N m" in served_view.table.content
    assert served_view.table.content.count("beyond its limit") == (abs(Q[0]) > 25)


def test_where_sliders_are_the_robot_rests(served_view):
    served_view.playing.value = True
    served_view.joints[0].value = 0.5
    served_view.joints[1].value = -0.25
    assert not served_view.playing.value
    q = np.array([0.5, -0.25])
    now = rest_state(ARM, q, np.eye(4))
    np.testing.assert_allclose(now.Q, ARM.gravity_forces(q), atol=1e-12)
    np.testing.assert_allclose(shown_poses(served_view), ARM.poses(q), atol=1e-12)
    np.testing.assert_allclose(shown_force(served_view, "base force")[1], [0, 2 * 9.81, 0], atol=1e-4)
    assert f"{now.Q[0]:.4g} N m" in served_view.table.content


def test_a_motion_plays_at_its_speed_and_begins_again(served_view):
    served_view.time.value, served_view.speed.value, served_view.playing.value = 2.0, 0.5, True
    served_view.tick(0.3, 100.0)
    assert served_view.time.value == pytest.approx(2.15)
    assert served_view.plot.data[-1].argmax() == np.abs(served_view.plot.data[0] - 2.15).argmin()
    served_view.tick(5.0, 100.1)
    assert served_view.time.value == 1.0
    served_view.playing.value = False
    served_view.tick(0.3, 100.2)
    assert served_view.time.value == 1.0


def test_sliders_reach_all_limits_and_all_of_the_motion(served_view):
    first, second = ((slider.min, slider.max) for slider in served_view.joints)
    assert first == pytest.approx((-2, 2), abs=1e-3)  # the motion leaves the limits of 1.95 rad
    assert second == (-np.pi, np.pi)


def test_the_curves_are_those_of_the_forces(recorded_track):
    times, *Q, mark = viewer.curves_of(recorded_track, 1.3)
    assert len(times) <= viewer.VIEW_CURVE_POINTS + 3
    assert (np.diff(times) > 0).all()
    np.testing.assert_allclose(
        Q, [np.interp(times, recorded_track.t, of_joint) for of_joint in recorded_track.Q.values.T]
    )
    assert times[mark > recorded_track.Q.values.min()] == [1.3]


MESH = '<visual>{}<geometry><mesh filename="{}" scale="2 1 0.5"/></geometry></visual>'
SHAPES = (
    f'<visual>{origin((0.1, 0, 0), (0, 0, 0.5))}<geometry><box size="0.1 0.2 0.3"/></geometry></visual>'
    '<visual><geometry><cylinder radius="0.05" length="0.4"/></geometry></visual>'
    '<visual><geometry><sphere radius="0.07"/></geometry></visual>'
)


@pytest.fixture
def shapes(tmp_path):
    folder = tmp_path / "arm_description" / "urdf"
    folder.mkdir(parents=True)
    (folder.parent / "meshes").mkdir()
    (folder.parent / "package.xml").write_text("<package/>")
    trimesh.creation.box((1, 1, 1)).export(folder.parent / "meshes" / "box.stl")
    (folder / "odd.stl").write_bytes(b"solid nothing")
    files = ("package://arm_description/meshes/box.stl", "no.stl", "odd.stl", "../meshes/box.stl")
    meshes = [MESH.format("", name) for name in files]
    links = [
        link("base", inner=SHAPES), link("arm", BODY, meshes[0]), link("hand", BODY, meshes[1]),
        link("tool", BODY, meshes[2]), link("tip", inner=MESH.format(origin((0, 0, 1)), files[3])),
    ]  # fmt: skip
    joints = [joint("a", "base", "arm"), joint("b", "arm", "hand"), joint("c", "hand", "tool")]
    return robot_file(folder, *links, *joints, joint("d", "arm", "tip", "fixed"))


def test_shapes_of_a_file_are_drawn_where_it_says(shapes):
    robot = jounce.load(shapes)
    with viewer.serve_robot(robot, shapes, None, 0) as served:
        names = set(served.server.scene._handle_from_node_name)
        [note] = served.scene.notes
    drawn = {name for name in names if "visual" in name}
    assert {name.rpartition("/visual")[0] for name in drawn} == {"/ground", "/body0"}
    assert len(drawn) == 5
    assert {name.rpartition("/part")[0] for name in names if "/part" in name} == {"/body1", "/body2"}  # the others'
    assert "'no.stl' (no such file)" in note
    assert "'odd.stl' (" in note
    tip = read_visuals(shapes)[-1]
    assert (tip.link, tip.kind, tip.T[2, 3], tip.size.tolist()) == ("tip", "mesh", 1, [2, 1, 0.5])
    assert read_mesh(tip, shapes).extents.tolist() == [2, 1, 0.5]


def test_meshes_are_found_by_path_and_by_package(shapes, tmp_path, monkeypatch):
    box = shapes.parent.parent / "meshes" / "box.stl"
    found = [box.as_uri().replace("%20", " "), "../meshes/box.stl", "package://arm_description/meshes/box.stl"]
    assert all(find_mesh(uri, shapes).samefile(box) for uri in found)
    assert find_mesh("package://arm_description/meshes/box.stl", tmp_path.parent / "elsewhere.urdf") == NO_FILE
    sibling = tmp_path / "robot" / "urdf" / "robot.urdf"
    assert find_mesh("package://arm_description/meshes/box.stl", sibling).samefile(box)
    for name, folder in (("ROS_PACKAGE_PATH", tmp_path), ("AMENT_PREFIX_PATH", tmp_path / "install")):
        (tmp_path / "install").mkdir(exist_ok=True)
        (tmp_path / "install" / "share").exists() or (tmp_path / "install" / "share").symlink_to(tmp_path)
        monkeypatch.setenv(name, f"/no/such{os.pathsep}{folder}")
        assert find_mesh("package://arm_description/meshes/box.stl", Path("/elsewhere.urdf")).samefile(box)
        (tmp_path / "secret.stl").touch()
        assert find_mesh("package://arm_description/../secret.stl", Path("/elsewhere.urdf")) == str(OUTSIDE)
        monkeypatch.delenv(name)
    assert find_mesh("", shapes) == NO_FILE


def test_meshes_elsewhere_are_not_read_unless_their_folder_is_named(shapes, tmp_path):
    secret = tmp_path / "private" / "secret.stl"
    secret.parent.mkdir()
    box = shapes.parent.parent / "meshes" / "box.stl"
    secret.write_bytes(box.read_bytes())
    (shapes.parent / "link.stl").symlink_to(secret)
    for uri in (str(secret), secret.as_uri(), "../../private/secret.stl", "link.stl"):
        assert find_mesh(uri, shapes) == str(OUTSIDE)
        assert find_mesh(uri, shapes, [tmp_path / "other"]) == str(OUTSIDE)
        assert find_mesh(uri, shapes, [secret.parent]).samefile(secret)
    for package in ("private", "arm_description/../private"):
        assert find_mesh(f"package://{package}/secret.stl", shapes) == str(OUTSIDE)
    for package in ("..", ".", "", str(tmp_path)):
        assert find_mesh(f"package://{package}/secret.stl", shapes) == NO_FILE
    assert find_mesh("package://private/secret.stl", shapes, [tmp_path]).samefile(secret)
    assert find_mesh("package://private/secret.stl", shapes, [secret.parent]).samefile(secret)
    (shapes.parent.parent / "package.xml").unlink()
    assert find_mesh("../meshes/box.stl", shapes) == str(OUTSIDE)
    assert find_mesh("package://arm_description/meshes/box.stl", shapes) == str(OUTSIDE)


def test_a_mesh_names_materials_in_its_own_folder_only(tmp_path):
    (tmp_path / "material.mtl").write_text("newmtl red\nKd 1 0 0\n")
    (tmp_path / "sub").mkdir()
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    for place, red in (("material.mtl", True), ("../material.mtl", False)):
        mesh = tmp_path / ("mesh.obj" if red else "sub/mesh.obj")
        mesh.write_text(f"mtllib {place}\n{vertices}usemtl red\nf 1 2 3\n")
        path = robot_file(tmp_path, link("base", inner=MESH.format("", mesh.relative_to(tmp_path))), link("arm", BODY),
                          joint("a", "base", "arm"))  # fmt: skip
        found = read_mesh(read_visuals(path)[0], path)
        colour = getattr(getattr(found.visual, "material", None), "main_color", np.zeros(4))
        assert (list(colour[:3]) == [255, 0, 0]) is red
    own = _folder_resolver(tmp_path / "sub" / "mesh.obj")
    with pytest.raises(ValueError, match="outside of the folder of the mesh"):
        own.get("../material.mtl")
    (tmp_path / "sub" / "own.mtl").write_text("Kd 1 0 0")
    assert own.get("own.mtl") == b"Kd 1 0 0"


def test_commands_name_folders_of_meshes(shapes, tmp_path):
    (shapes.parent.parent / "package.xml").unlink()
    (tmp_path / "still.yaml").write_text(
        "time: {stop: 1, count: 9}\njoints: {a: {offset: 0}, b: {offset: 0}, c: {offset: 0}}\n"
    )
    words = ["report", str(shapes), str(tmp_path / "still.yaml"), "-o", str(tmp_path / "page.html")]
    notes = []
    for more in ([], ["--meshes", str(shapes.parent.parent)]):
        result = call(*words, *more)
        assert result.exit_code == 0, result.output
        notes.append((tmp_path / "page.html").read_text())
    for folders in ([], [shapes.parent.parent]):
        with viewer.serve_robot(jounce.load(shapes), shapes, None, 0, folders) as served:
            notes.append(" ".join(served.scene.notes))
    assert ["--meshes FOLDER allows it" in note for note in notes] == [True, False, False, False]
    assert ["mesh_folders=[...] allows it" in note for note in notes] == [False, False, True, False]


def test_shapes_of_a_floating_base_are_drawn(shapes):
    robot = jounce.load(shapes, base="floating", root="arm")
    assert [visual.link for visual in robot_visuals(robot.mechanism, shapes)] == ["arm", "hand", "tool", "tip"]


def test_names_of_a_file_are_text_on_the_page(tmp_path):
    name = "<b onclick='x()'>\u202e"
    robot = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [np.eye(6)], joint_names=[name], name=name)
    table = viewer.table_of(robot, rest_state(robot, np.zeros(1), np.eye(4)))
    assert "&lt;b onclick=" in table
    assert "<b " not in table
    assert "\u202e" not in table


def test_the_title_is_the_name_of_the_robot():
    robot = jounce.Robot(replace(ARM.mechanism, name="</title><script>hacked = 1</script>"))
    with viewer.serve_robot(robot, Path("planar2r"), None, 0) as served, urlopen(served.address, timeout=20) as page:
        text = page.read()
    assert int(page.headers["Content-Length"]) == len(text)
    assert b"<title>&lt;/title&gt;&lt;script&gt;hacked = 1&lt;/script&gt;</title>" in text
    assert b"<script>hacked" not in text


def test_the_time_axis_is_in_seconds_from_the_start_of_the_motion(served_view, recorded_track):
    assert served_view.plot.scales == {"x": {"time": False}}
    assert served_view.plot.title.endswith("t [s]")
    assert served_view.plot.data[0][[0, -1]].tolist() == recorded_track.t[[0, -1]].tolist() == [1, 3]


def test_rounding_noise_is_shown_as_zero():
    state = rest_state(ARM, np.zeros(2), np.eye(4))
    noisy = replace(state, Q=np.array([-7.9e-19, 4e-11]), F=np.array([-1e-300, -0.0, 12.0, 3e-12, -1e-9, 19.62]))
    cells = re.findall("<td>(.*?)</td>", viewer.table_of(ARM, noisy))
    assert cells[1::2] == ["0 N m", "4e-11 N m", "(0, -1e-09, 19.62) N", "(0, 0, 12) N m"]


@pytest.mark.parametrize("name", ["iiwa14", "solo12"])
def test_links_are_of_one_colour_and_joints_of_another(name):
    robot = jounce.load(name)
    with viewer.serve_robot(robot, Path(name), None, 0) as served:
        meshes = [x for key, x in served.server.scene._handle_from_node_name.items() if "/part" in key]
        colours = {tuple(mesh.color) for mesh in meshes}
    expected = [tuple(bytes.fromhex(colour[1:])) for colour in (LINK, scene.JOINT_COLOUR)]
    assert colours == set(expected)


@pytest.mark.parametrize(("words", "opened"), [((), 1), (("--no-open",), 0)], ids=["by default", "--no-open"])
def test_a_terminal_opens_the_page_unless_told_not_to(words, opened, monkeypatch):
    addresses = []
    monkeypatch.setattr("webbrowser.open", addresses.append)
    monkeypatch.setattr(viewer, "run", lambda *_: None)
    monkeypatch.setattr("jounce.cli.pages.has_desktop_terminal", lambda: True)
    printed = run("view", "planar2r", "--port", "0", *words).stdout
    assert addresses == re.findall(r"shown at (\S+);", printed)[:opened]
    assert len(addresses) == opened


@pytest.mark.parametrize(
    ("terminal", "platform", "display", "expected"),
    [
        (True, "linux", ":0", True),
        (True, "linux", "", False),  # a session without windows
        (True, "darwin", "", True),
        (False, "linux", ":0", False),  # a pipe
    ],
)
def test_pages_open_on_terminals_of_desktops_only(terminal, platform, display, expected, monkeypatch):
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(isatty=lambda: terminal))
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert pages.has_desktop_terminal() is expected


@pytest.mark.outside
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome in the path")
def test_axe_finds_nothing_serious_on_the_page(served_view):
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto(served_view.address, timeout=60_000)
        page.get_by_role("slider", name="joint2 [rad]").wait_for(timeout=60_000)
        assert page.title() == "planar2r"
        found = axe.Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
        browser.close()
    assert [(fault["id"], fault["help"]) for fault in found if fault["impact"] in ("serious", "critical")] == []


def test_the_command_serves_until_it_is_interrupted(motion_file, tmp_path):
    command = [sys.executable, "-m", "jounce", "view", "planar2r", str(motion_file), "--port", "0"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        address = re.search(r"planar2r is shown at (http://127.0.0.1:\d+); Ctrl-C ends it", process.stdout.readline())
        assert address, process.stderr.read()
        with urlopen(address[1], timeout=20) as page:
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, output, errors) == (0, "ended\n", "")


def test_refusals(motion_file, monkeypatch):
    assert "joint3" in run("view", "iiwa14", motion_file, code=2).stderr
    assert run("view", "planar2r", "--step", "0.1", code=2).stderr == "Error: --step needs a MOTION\n"
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        assert f"port {port} cannot be used: " in run("view", "planar2r", "--port", port, code=2).stderr
    monkeypatch.setitem(sys.modules, "viser", None)
    refusal(scene.check_installed, "the live view needs viser", "pip install 'jounce[view]'")


@pytest.mark.parametrize("floats", [False, True], ids=["ground", "floating"])
def test_a_robot_is_shown_where_its_base_is(loaded_motion, floats):
    robot = jounce.Robot(floating(ARM.mechanism, np.random.default_rng(0))) if floats else ARM
    C = np.tile(np.eye(4), (9, 1, 1))
    C[:, :3, 3] = [1.0, 2.0, 3.0] + np.sin(np.linspace(0, np.pi, 9))[:, None]
    moved = loaded_motion.with_base(np.linspace(1, 3, 9), C, degree=5)
    with viewer.serve_robot(robot, Path("planar2r"), record_track(robot, moved), 0) as served:
        served.time.value = 2.0
        np.testing.assert_allclose(served.scene.ground.position, [2, 3, 4], atol=1e-3)
        expected = np.asarray(robot.poses(served.along.at(2.0).q, base=served.along.at(2.0).C))[-2:]
        np.testing.assert_allclose(shown_poses(served), expected, atol=1e-9)
        served.joints[0].value = 0.3
        np.testing.assert_allclose(served.scene.ground.position, [2, 3, 4], atol=1e-3)
        assert served.table.content.count("N m") == 3
