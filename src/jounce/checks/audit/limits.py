"""What a file states of joints: limits and axes that it leaves out, limits in degrees, and names that are formulas."""

from collections.abc import Iterator

import numpy as np

from jounce.checks.audit.finding import Finding
from jounce.model.coordinates import MAX_UNLIMITED_ANGLE, leading_joints
from jounce.model.limit_kinds import kind_units
from jounce.model.mechanism import Mechanism, single_variables

_MAX_DEGREES = 720.0  # two turns: a larger position limit stands for no limit rather than for degrees
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # of cells that spreadsheets take for formulas


def check_stated_limits(mechanism: Mechanism) -> Iterator[Finding]:
    """Effort and velocity limits that are missing or zero, of the joints that are driven; a finding for each kind."""
    alone = single_variables(mechanism).values()  # no motor turns a ball
    driven = sorted({*alone} & {*leading_joints(mechanism)})  # what follows others has no drive of its own
    for kind, act in (("effort", "exert a force"), ("velocity", "move")):
        stated, unit = getattr(mechanism.limits, kind)[driven], kind_units(kind)
        missing, zero = np.isinf(stated), stated == 0
        everywhere = bool(missing.all())
        others = " on any joint" if everywhere else f", unlike the other {int((~missing).sum())}"
        if missing.any():
            yield Finding(
                severity="note" if everywhere else "warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(missing, driven)),
                number=float(missing.sum()),
                unit="joints",
                text=f"no {kind} limit{others}",
                advice=f"nothing checks a motion against it; state {kind}= in {unit}",
            )
        if zero.any():
            yield Finding(
                severity="warning",
                kind=f"{kind} limit",
                joints=tuple(mechanism.joints[i] for i in np.compress(zero, driven)),
                number=0.0,
                unit=unit,
                text=f"{kind} limit 0: the joint could never {act}",
                advice=f"state that of the drive in {unit}, or omit it if it is unknown",
            )


def check_degrees(mechanism: Mechanism) -> Iterator[Finding]:
    """Position limits of revolute joints that look like degrees."""
    largest = np.maximum(
        *(np.nan_to_num(np.abs(x), posinf=0) for x in (mechanism.limits.lower, mechanism.limits.upper))
    )
    found = np.flatnonzero(mechanism.X[:, :3].any(axis=1) & (largest > MAX_UNLIMITED_ANGLE) & (largest <= _MAX_DEGREES))
    if not found.size:
        return
    worst = float(largest[found].max())
    yield Finding(
        severity="warning",
        kind="position limit",
        joints=tuple(mechanism.joints[i] for i in found),
        number=worst,
        unit="rad",
        text=f"position limit of up to {worst:.4g} rad, {worst / (2 * np.pi):.3g} turns: it looks like degrees",
        advice=f"limits are in rad: {worst:.4g} deg are {np.deg2rad(worst):.4g} rad",
    )


def check_axes(mechanism: Mechanism) -> Iterator[Finding]:
    """Joints whose axis the file leaves out."""
    found = tuple(joint for joint in mechanism.default_axes if joint in mechanism.joints)
    if not found:
        return
    yield Finding(
        severity="note",
        kind="axis",
        joints=found,
        number=float(len(found)),
        unit="joints",
        text="the file states no <axis>: the axis is the format's default, 1 0 0",
        advice='state it: <axis xyz="1 0 0"/>',
    )


def check_formulas(mechanism: Mechanism) -> list[Finding]:
    """Names of joints and links that a spreadsheet computes: they are heads of columns, and cells of tables."""
    joints = tuple(name for name in mechanism.joints if name.startswith(FORMULA_STARTS))
    links = tuple(name for name in mechanism.frame_names if name.startswith(FORMULA_STARTS))
    return [
        Finding(
            severity="warning",
            kind="name",
            bodies=() if of == "joints" else names,
            joints=names if of == "joints" else (),
            number=float(len(names)),
            unit=of,
            text=f"the name begins with {names[0][0]!r}: spreadsheets that open a CSV table execute it as a formula",
            advice="rename it in the file, or import tables as text",
        )
        for of, names in (("joints", joints), ("links", links))
        if names
    ]
