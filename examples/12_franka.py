"""A jerk-limited motion of a Franka Panda trips; the fastest one along its path does not. It draws franka.svg."""

from pathlib import Path

import numpy as np
import ruckig

import jounce
from jounce.figures import canvas

HOME = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
GOAL = [1.0, 0.2, -0.4, -1.6, 0.5, 2.3, -0.4]
RATE = 1000.0  # N m/s, of Q - Qgrav

robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
robot = robot.with_limits("panda")  # the published ones, with the source of each
limits = robot.limits

asked, trajectory = ruckig.InputParameter(robot.n), ruckig.Trajectory(robot.n)
asked.current_position, asked.target_position = HOME, GOAL
asked.max_velocity, asked.max_acceleration = list(limits.velocity), list(limits.acceleration)
asked.max_jerk = list(limits.jerk)
ruckig.Ruckig(robot.n).calculate(asked, trajectory)
planned = jounce.Motion.from_ruckig(trajectory)
motions = {
    "planned within limits of jerk": planned,
    "retimed": robot.retime(planned).motion,
}


def largest_rate(motion):
    """Times, and the largest torque rate of all joints then."""
    breaks = np.array([found.t for found in motion.breaks])
    t = np.unique([*np.linspace(motion.start, motion.stop, 301), *breaks, *(breaks - 1e-6)]).clip(motion.start)
    along = robot.forces_along(motion, t, order=1)
    gravity = robot.gravity_forces(*along.rates[:2])
    return t, np.abs(along.forces[1] - gravity[1]).max(axis=1)


def paint(figure):
    axes, entries = figure.subplots(), {}
    for (name, motion), colour in zip(motions.items(), (canvas.COLOURS[1], canvas.COLOURS[0]), strict=True):
        entries[f"{name}, {motion.duration:.2f} s"] = style = {"color": colour, "linewidth": 1.4}
        axes.semilogy(*largest_rate(motion), **style)
    entries["limit, 1000 N m/s"] = style = {"color": canvas.INK, "linewidth": 1.0, "linestyle": (0, (5, 2))}
    axes.axhline(RATE, **style)
    axes.axhspan(RATE, 2e4, color=canvas.COLOURS[1], alpha=0.07, linewidth=0)
    axes.set(xlim=(0, None), ylim=(50, 2e4), xlabel="t [s]", ylabel="largest torque rate of a joint [N m/s]")
    canvas.legend_above(figure, entries)


for name, motion in motions.items():
    print(f"{name}, {motion.duration:.2f} s: {robot.check(motion).worst}")
canvas.save(canvas.painted(paint, 7, 3.6), Path("franka.svg"))
