"""A table of a motion of the Panda between four postures, 200 Hz, C^4 in every joint.

python examples/02_motion_between_postures.py motion.csv
jounce run examples/panda.urdf motion.csv --degree 7 -o forces.csv
"""

import csv
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

JOINTS = [f"panda_joint{i}" for i in range(1, 8)] + ["panda_finger_joint1"]
POSTURES = np.array([
    [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785, 0.04],
    [0.6, 0.10, 0.2, -2.00, -0.1, 2.10, 1.20, 0.04],
    [0.6, 0.35, 0.2, -2.10, -0.1, 2.45, 1.20, 0.01],
    [-0.7, -0.20, -0.3, -2.20, 0.2, 2.00, 0.10, 0.01],
])  # fmt: skip
SECONDS, RATE = 1.2, 200  # from posture to posture; samples a second

s = np.linspace(0, 1, int(SECONDS * RATE), endpoint=False)
blend = s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)  # four derivatives vanish at both ends
legs = [a + np.outer(blend, b - a) for a, b in pairwise(POSTURES)]
q = np.concatenate([*legs, POSTURES[-1:]])

out = Path(sys.argv[1] if sys.argv[1:] else "motion.csv")
with out.open("w", newline="") as file:
    writer = csv.writer(file)
    writer.writerow(["t", *JOINTS])
    writer.writerows([[k / RATE, *row] for k, row in enumerate(q.tolist())])
print(f"{len(q)} states written to {out}")
