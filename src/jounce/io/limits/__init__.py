"""Limits from files, and of arms by name.

A file is jounce's own, or a MoveIt ``joint_limits.yaml``:

units: SI                                     # m, kg, s, rad
angles: rad                                   # or deg: of positions and their rates, of motors too, where a joint turns
limits_of: {effort_rate: Q - Qgrav}           # which force effort limits bound: Q unless said otherwise
joints:
  joint1: {lower: -2.8, upper: 2.8, velocity: 2, effort: 87, effort_rate: [-1000, 800]}

A table of an arm is such a file, ``tables/NAME.yaml``, with `sources`: where each kind of number is published. It is
for the joints of a robot that have its names behind a common prefix.
"""
