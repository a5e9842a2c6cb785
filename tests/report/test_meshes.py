"""Reports draw the meshes of a URDF, few enough triangles of them, and say which they do not draw."""

import sys

import numpy as np
import pytest

import jounce
from jounce._report.drawing import LINK
from jounce._report.meshes import MAX_TRIANGLES
from support.commands import call
from support.files import BODY, joint, link, origin, robot_file
from support.pages import LARGEST, decoded, panel, parsed, words
from support.refusals import refusal

trimesh = pytest.importorskip("trimesh")
MESH = '<visual>{}<geometry><mesh filename="{}" scale="2 1 0.5"/></geometry></visual>'
BOX = '<visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual>'


def meshed_arm(folder, *meshes):
    """A base with a box, a stand fixed to it with another, and a chain of links that these meshes show."""
    links = [link("base", inner=BOX), link("stand", inner=BOX)]
    links += [link(f"l{k}", BODY, MESH.format(origin((0.1, 0, 0), (0, 0, 0.5)), name)) for k, name in enumerate(meshes)]
    names = ["base", *(f"l{k}" for k in range(len(meshes)))]
    joints = [joint(f"j{k}", names[k], names[k + 1], inner=origin((0, 0, 0.5))) for k in range(len(meshes))]
    stand = joint("bolts", "base", "stand", "fixed", inner=origin((0.3, 0, -0.2)))
    return robot_file(folder, *links, *joints, stand)


def page_of(file):
    robot = jounce.load(file)
    motion = jounce.Motion.polynomial([[0.0, 0.5]] * robot.n, 1.0)
    report = robot.report(motion, 0, visuals=file)
    page, data = parsed(report)
    return report, words(page, panel("robot_data")), data["robot"]


def points_of(solids, body):
    """The vertices that a page draws a body by, and their colours."""
    found = [(solid["colour"], decoded(solid["vertices"]).reshape(-1, 3), decoded(solid["bodies"])) for solid in solids]
    colours = {colour for colour, _, bodies in found if (bodies == body).any()}
    return np.concatenate([points[bodies == body] for _, points, bodies in found]), colours


def sorted_rows(points):
    return points[np.lexsort(points.round(6).T)]


def test_meshes_and_shapes_are_drawn_where_the_file_says(tmp_path):
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    trimesh.creation.icosphere(1, 0.2).export(tmp_path / "ball.obj")
    file = meshed_arm(tmp_path, "box.stl", "ball.obj")
    report, text, data = page_of(file)
    base, grey = points_of(data["solids"], -1)
    corners = trimesh.creation.box((0.1, 0.2, 0.3)).vertices
    np.testing.assert_allclose(
        sorted_rows(base), sorted_rows(np.concatenate([corners, corners + np.array([0.3, 0, -0.2])])), atol=1e-7
    )
    assert grey == {LINK}
    c, s = np.cos(0.5), np.sin(0.5)
    C = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    for body, mesh in enumerate((trimesh.creation.box((1, 2, 3)), trimesh.creation.icosphere(1, 0.2))):
        found, colours = points_of(data["solids"], body)
        expected = mesh.vertices * [2, 1, 0.5] @ C.T + [0.1, 0, 0]
        np.testing.assert_allclose(sorted_rows(found), sorted_rows(expected), atol=1e-6)
        assert len(colours) == 1
    assert LINK not in colours  # that of the joint
    low, high = np.array(data["space"]).T
    assert (low < base.min(axis=0)).all()
    assert high[2] > 1.0 + 0.1
    assert "capsules" not in text
    assert "simplified" not in text
    assert len(report.html) < LARGEST


def test_many_triangles_are_simplified_on_a_grid(tmp_path):
    sphere = trimesh.creation.uv_sphere(1.0, count=[310, 326])
    assert len(sphere.faces) > 200_000
    sphere.export(tmp_path / "sphere.ply")
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.stl")
    file = meshed_arm(tmp_path, "sphere.ply", "box.stl")
    report, text, data = page_of(file)
    count = sum(len(decoded(solid["triangles"])) // 3 for solid in data["solids"])
    assert MAX_TRIANGLES / 2 < count <= MAX_TRIANGLES
    assert "triangles are simplified to" in text
    assert len(report.html) < LARGEST
    assert len(points_of(data["solids"], 1)[0]) == 8
    [solid] = [solid for solid in data["solids"] if (decoded(solid["bodies"]) == 0).any()]
    points, triangles = decoded(solid["vertices"]).reshape(-1, 3), decoded(solid["triangles"]).reshape(3, -1).T
    c, s = np.cos(0.5), np.sin(0.5)
    back = (points - [0.1, 0, 0]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) / [2, 1, 0.5]
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, atol=0.03)
    found = trimesh.Trimesh(points, triangles, process=False)
    assert found.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)  # no triangle is turned over
    ordered = np.sort(triangles, axis=1)
    assert (np.diff(ordered, axis=1) > 0).all()
    assert len(np.unique(ordered, axis=0)) == len(triangles)


def test_links_with_unreadable_meshes_are_capsules(tmp_path, monkeypatch):
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    (tmp_path / "odd.stl").write_bytes(b"solid nothing")
    file = meshed_arm(tmp_path, "package://description/" + 80 * "x" + "/no&lt;b&gt;.stl", "odd.stl", "box.stl")
    _, text, data = page_of(file)
    bare = parsed(jounce.load(file).report(jounce.Motion.polynomial([[0.0, 0.5]] * 3, 1.0), 0))[1]["robot"]
    for body in (0, 1):
        found, capsules = (points_of(some["solids"], body)[0] for some in (data, bare))
        np.testing.assert_array_equal(sorted_rows(found), sorted_rows(capsules))
    assert len(points_of(data["solids"], 2)[0]) == 8
    assert "Meshes that cannot be read: 'no<b>.stl' (no such file), 'odd.stl' (" in text
    assert "capsules stand for links that nothing else shows." in text
    monkeypatch.setitem(sys.modules, "trimesh", None)
    _, text, data = page_of(file)
    assert data["solids"] == bare["solids"]
    assert "trimesh is not installed; install it by: pip install 'jounce[report]'." in text


def test_a_urdf_without_visuals_and_files_of_other_types(tmp_path):
    file = robot_file(tmp_path, link("base"), link("arm", BODY), joint("turn", "base", "arm"))
    assert "robot.urdf has no visuals of the links; capsules stand for them." in page_of(file)[1]
    robot, motion = jounce.load("planar2r"), jounce.Motion.polynomial([[0, 1], [0, 1]], 1.0)
    refusal(lambda: robot.report(motion, 0, visuals="arm.xml"), "visuals are read from .urdf files")
    refusal(lambda: robot.report(motion, 0, visuals=tmp_path / "no.urdf"), "no such file")
    refusal(lambda: robot.report(motion, 0, visuals=3), "3 is not a path")


def test_the_command_draws_the_meshes_of_its_robot(tmp_path):
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    motion, page = tmp_path / "motion.yaml", tmp_path / "report.html"
    motion.write_text("time: {start: 0, stop: 1, count: 11}\njoints: {j0: {polynomial: [0, 2]}}")
    result = call("report", meshed_arm(tmp_path, "box.stl"), motion, "-o", page)
    assert result.exit_code == 0, result.output
    assert "and the meshes that they move, have" in page.read_text(encoding="utf-8")
