"""Generated JavaScript: what `test_codegen` does not ask of every language."""

import json
import subprocess

import numpy as np
import pytest
from test_codegen import ALL, PARAMETERS, made_robot, texts, write_files

from support.tools import NODE, needs

pytestmark = needs(NODE)


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    options = {"order": 1, "outputs": ALL, "wrench": True, "parameters": PARAMETERS}
    files = texts("planar2r", "javascript", 1, **options)
    plain = texts("planar2r", "javascript", 1, order=0)["planar2r.mjs"]
    return write_files(tmp_path_factory.mktemp("code"), files | {"plain.mjs": plain})


IMPORTS = "import * as arm from './plain.mjs'; import * as all from './planar2r.mjs';"


def run_script(folder, statements):
    """What statements leave in `found`, where `arm` is the code without parameters and `all` that with them."""
    code = f"{IMPORTS} let found; {statements}; console.log(JSON.stringify(found));"
    words = [NODE, "--input-type=module", "-e", code]
    return json.loads(subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True).stdout)


def test_node_reads_every_file(scripts):
    for path in scripts.glob("*.mjs"):
        subprocess.run([NODE, "--check", path], check=True)


def test_results_go_where_the_caller_says(scripts):
    """Into arrays of any type, that of an input among them, and into new ones."""
    q, qd, q2d = [0.3, -0.4], [0.5, 0.6], [-0.7, 0.8]
    calls = f"""const x = Float64Array.of(...{q}), y = new Float32Array(2);
        const [made] = arm.inverse_dynamics(x, {qd}, {q2d});
        arm.inverse_dynamics(x, {qd}, {q2d}, y);
        const same = arm.inverse_dynamics(x, {qd}, {q2d}, x)[0] === x;
        found = [[...made], [...y], [...x], same, made instanceof Float64Array]"""
    made, single, over, *truths = run_script(scripts, calls)
    Q = made_robot("planar2r").inverse_dynamics(q, qd, q2d)
    np.testing.assert_allclose(made, Q, rtol=1e-14)
    np.testing.assert_allclose(single, Q, rtol=1e-7)
    assert over == made
    assert truths == [True, True]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("arm.inverse_dynamics([0], [0, 0], [0, 0])", "RangeError: q has 1 entries, expected 2"),
        ("arm.inverse_dynamics([0, 0], [0, 0])", "RangeError: q2d has no entries, expected 2"),
        ("arm.inverse_dynamics([0, 0], [0, 0], 5)", "RangeError: q2d has no entries, expected 2"),
        ("arm.inverse_dynamics([0, 0], [0, 0], [0, 0], [0])", "RangeError: Q has 1 entries, expected 2"),
        ("all.mass_matrix([0, 0], [0, 0], {...all.OWN, gravity: [0, 9]})", "params.gravity has 2 entries, expected 3"),
        ("all.mass_matrix([0, 0], [0, 0], {...all.OWN, payload_mass: '1'})", "payload_mass is 1, expected a number"),
    ],
)
def test_what_would_give_no_numbers_is_refused(scripts, call, message):
    assert message in run_script(scripts, f"try {{ {call} }} catch (error) {{ found = String(error) }}")
