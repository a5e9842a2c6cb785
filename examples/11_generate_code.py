"""Q, Qd and Q2d as C code that needs no jounce, with tests: python examples/11_generate_code.py FOLDER"""

import sys
import tempfile
from pathlib import Path

import jounce

out = Path(sys.argv[1]) if sys.argv[1:] else Path(tempfile.mkdtemp())
robot = jounce.load("iiwa14")
made = robot.codegen(
    "c",  # or cpp, cuda, julia, latex, matlab, python, rust
    order=2,
    directory=out / "iiwa14-c",
    outputs=["inverse_dynamics", "jacobian:link7:world"],
    parameters=["payload"],  # mass, centre of mass and inertia of what the robot holds, at run time
)
print(made.directory, *made.files, sep="\n  ")
for function, operations in made.operations.items():
    print(f"{function}: {operations} operations")
print(f"make -C {made.directory} test   # compares it with the closed form")
