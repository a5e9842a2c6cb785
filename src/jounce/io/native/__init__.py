"""jounce's own robot files, YAML or JSON: all data of a mechanism, to the last bit, readable and editable.

name: arm
units: SI                       # m, kg, s, rad
gravity: [0, 0, -9.81]
bodies:
  - name: link1
    parent: ground              # or a body above
    pose: {position: [0, 0, 0.3], rpy: [0, 0, 1.57]}
    joint: {name: joint1, type: revolute, axis: [0, 0, 1], limits: {lower: -2, upper: 2}}
    inertia: {mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
frames:
  - {name: tool0, body: link1, pose: {position: [0, 0, 0.2]}}

A joint of several screws is a ball, planar or free; limits and drives are those of its velocities:

    joint: {name: rod, type: ball, point: [0, 0, 0.1], velocities: {wx: {drive: {damping: 0.1}}}}

A robot that floats states its base, which is the parent of bodies and frames instead of the ground:

base: {name: trunk, inertia: {mass: 9, com: [0, 0, 0], inertia: [0.1, 0, 0, 0.2, 0, 0.2]}}
"""

GROUND_NAME = "ground"  # what roots stand on; no name of a body
BASE_KEY = "base"
BAND_KEY = "confirmed_band"  # Hz, up to which torques confirmed positions where the robot was identified
FILE_UNITS = "SI"
