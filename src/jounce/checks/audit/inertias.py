"""Inertias that no body can have, and joints that move none."""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from jounce.checks.audit.finding import Finding
from jounce.dynamics.mobility import find_massless, idle_coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia

_TENSOR_TOLERANCE = 1e-9  # of the largest entry of a tensor: less is rounding, and breaks no law
_MOMENT_TOLERANCE = 1e-6  # relative: what poses and Steiner's theorem leave of copied moments
_MEASURE = "take it from CAD, a data sheet or an identification"


def check_inertias(mechanism: Mechanism) -> list[Finding]:
    """Negative masses and moments, and principal moments that break the triangle inequality.

    Second moments about the COM that are positive semidefinite are the same as: principal moments non-negative and
    within the triangle inequality.
    """
    found = [_find_defect(body, M) for body, M in zip(mechanism.bodies, mechanism.M, strict=True)]
    return [finding for finding in found if finding is not None]


def _find_defect(body: str, M: np.ndarray) -> Finding | None:
    error = partial(Finding, severity="error", bodies=(body,))
    mass, largest = float(M[3, 3]), float(np.abs(M[:3, :3]).max())
    if mass < 0:
        text, advice = (
            f"mass {mass:g} kg is negative",
            "state the mass of the body, or omit the mass of a massless body",
        )
        return error(kind="negative mass", number=mass, unit="kg", text=text, advice=advice)
    if mass == 0:
        text, advice = "massless, yet with moments of inertia", "state a mass, or no inertia"
        massless = error(kind="moments without mass", number=largest, unit="kg m^2", text=text, advice=advice)
        return massless if np.any(M) else None
    principal = inertia.principal_moments(M)
    least, slack = float(principal[0]), inertia.triangle_slack(principal)
    if least < -_TENSOR_TOLERANCE * largest:
        text = f"principal moment {least:.3g} kg m^2 about the COM is negative"
        advice = "check the signs of the products of inertia, and that the tensor is about the COM, not the link frame"
        return error(kind="negative moment", number=least, unit="kg m^2", text=text, advice=advice)
    if slack < -_TENSOR_TOLERANCE * largest:
        share = f"{-100 * slack / float(principal[2]):.2g} % of the largest"
        text = f"principal moments about the COM violate the triangle inequality by {-slack:.3g} kg m^2, {share}"
        advice = "keep more digits or use the nearest valid tensor; a large violation is a wrong axis, sign or order"
        return error(kind="triangle inequality", number=slack, unit="kg m^2", text=text, advice=advice)
    return None


def check_placeholders(mechanism: Mechanism) -> Iterator[Finding]:
    """Tensors of one round number times the identity, and the same tensor on bodies of different mass."""
    M = mechanism.M
    massive = np.flatnonzero(M[:, 3, 3] > 0)
    moments = np.array([inertia.principal_moments(M[i]) for i in massive]).reshape(-1, 3)
    left = np.ones(len(massive), dtype=bool)
    for i, own in zip(massive, moments, strict=True):
        alike = massive[left & np.isclose(moments, own, rtol=_MOMENT_TOLERANCE, atol=0).all(axis=1)]
        if i not in alike or is_point(M[i]):
            continue
        left &= ~np.isin(massive, alike)
        masses = M[alike, 3, 3]
        if _is_round(own):
            text = f"moments about the COM are {own[0]:.3g} kg m^2 times the identity"
        elif max(masses) > 1.01 * min(masses):
            spread = f"from {min(masses):.3g} to {max(masses):.3g} kg"
            text = f"the same principal moments, up to {own[2]:.3g} kg m^2, on {len(alike)} bodies {spread}"
        else:
            continue
        yield _describe_placeholder(mechanism, alike.tolist(), float(own[2]), "kg m^2", text, "inertia")


def check_unit_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Masses of exactly 1 kg on most bodies, at least three."""
    masses = mechanism.M[:, 3, 3]
    ones = [i for i, mass in enumerate(masses) if mass == 1]
    if len(ones) < 3 or 2 * len(ones) <= len(masses):
        return
    text = f"mass 1 kg on {len(ones)} of {len(masses)} bodies"
    yield _describe_placeholder(mechanism, ones, 1.0, "kg", text, "mass")


def check_point_masses(mechanism: Mechanism) -> Iterator[Finding]:
    """Bodies with mass and no moments about their COM."""
    inertias = mechanism.M
    points = [i for i, M in enumerate(inertias) if M[3, 3] > 0 and is_point(M)]
    if not points:
        return
    heaviest = float(max(inertias[i, 3, 3] for i in points))
    yield Finding(
        severity="note",
        kind="point mass",
        bodies=_body_names(mechanism, points),
        number=heaviest,
        unit="kg",
        text=f"mass, {heaviest:.3g} kg at most, without moments about its COM",
        advice="fine for a point mass; otherwise state the moments of inertia",
    )


def is_point(M: np.ndarray) -> bool:
    """Whether a body with mass has no moments about its COM beyond rounding."""
    return bool(np.abs(inertia.principal_moments(M)).max() <= _TENSOR_TOLERANCE * np.abs(M[:3, :3]).max())


def _is_round(moments: np.ndarray) -> bool:
    """Whether three moments are one number of one digit, such as 1, 0.1 or 0.002."""
    number = float(f"{moments[2]:.0e}")
    return bool(np.allclose(moments, number, rtol=_MOMENT_TOLERANCE, atol=0))


def _describe_placeholder(
    mechanism: Mechanism, bodies: Sequence[int], number: float, unit: str, text: str, what: str
) -> Finding:
    return Finding(
        severity="warning",
        kind=f"placeholder {what}",
        bodies=_body_names(mechanism, bodies),
        number=number,
        unit=unit,
        text=f"{text}: a placeholder",
        advice=f"the forces are wrong until it is replaced; {_MEASURE}",
    )


def _body_names(mechanism: Mechanism, bodies: Iterable[int]) -> tuple[str, ...]:
    return tuple(mechanism.bodies[i] for i in bodies)


def check_massless(mechanism: Mechanism) -> Iterator[Finding]:
    """Find massless bodies: those that carry mass, which have no effect, and those that carry none."""
    between, tips = map(np.flatnonzero, find_massless(mechanism))
    if between.size:
        yield Finding(
            severity="note",
            kind="massless",
            bodies=_body_names(mechanism, between),
            number=0.0,
            unit="kg",
            text="massless, but carries bodies with mass: no effect on forces or mass matrix",
            advice="correct for an intermediate frame of a joint with several axes; otherwise state the inertia",
        )
    if tips.size:
        yield Finding(
            severity="warning",
            kind="massless tip",
            bodies=_body_names(mechanism, tips),
            number=0.0,
            unit="kg",
            text="massless, as is everything it carries: its joint needs no force",
            advice="state the inertia, or make the joint fixed",
        )


def check_singular(mechanism: Mechanism) -> Iterator[Finding]:
    """Coordinates that move without kinetic energy in every configuration: no forward dynamics, no ``M^-1``."""
    rank, idle = idle_coordinates(mechanism)
    if not idle:
        return
    unit = "coordinates" if mechanism.base_body is None else "velocities"
    yield Finding(
        severity="error",
        kind="singular mass matrix",
        joints=idle,
        number=float(mechanism.nv - rank),
        unit=unit,
        text=f"moves no inertia{' together' if len(idle) > mechanism.nv - rank else ''}: "
        f"the mass matrix is singular, of rank {rank} for {mechanism.nv} {unit}",
        advice="inverse dynamics is not affected; for forward dynamics state the inertia, or fix the joint",
    )
