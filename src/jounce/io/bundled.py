"""The robots that come with jounce, as functions of their parameters."""

from collections.abc import Callable

import numpy as np

from jounce._scalars import Array
from jounce.inertia import inertia_matrix, symmetric
from jounce.lie import pose
from jounce.mechanism import Mechanism
from jounce.screws import from_screws

# KUKA LBR iiwa 14 R820, the table of Müller & Kumar, Section 6.2: mass in kg; centre of mass in m; inertia about it in
# kg m^2, axes parallel to the link frame, in the order xx, xy, xz, yy, yz, zz (the paper heads its third column "yx";
# it is xz). Links 4 and 7 break the triangle inequality, by 2.9e-4 and 5.7e-5 kg m^2: rounded, identified data.
IIWA14 = np.array([
    [3.94781, -0.00351, 0.00160, -0.03139, 0.00455, 0.00000, -0.00000, 0.00454, 0.00001, 0.00029],
    [4.50275, -0.00767, 0.16669, -0.00355, 0.00032, 0.00000, 0.00000, 0.00010, -0.00000, 0.00042],
    [2.45520, -0.00225, -0.03492, -0.02652, 0.00223, -0.00005, 0.00007, 0.00219, 0.00007, 0.00073],
    [2.61155, 0.00020, -0.05268, 0.03818, 0.03844, 0.00088, -0.00112, 0.01144, -0.00111, 0.04988],
    [3.41000, 0.00005, -0.00237, -0.21134, 0.00277, -0.00001, 0.00001, 0.00284, -0.00000, 0.00012],
    [3.38795, 0.00049, 0.02019, -0.02750, 0.00050, -0.00005, -0.00003, 0.00281, -0.00004, 0.00232],
    [0.35432, -0.03466, -0.02324, 0.07138, 0.00795, 0.00022, -0.00029, 0.01089, -0.00029, 0.00294],
])  # fmt: skip
R3, R5 = 0.42, 0.40  # m; not in the paper, from the authors' published code

_UP, _DOWN = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[1, 0, 0], [0, 0, 1], [0, -1, 0]]


def iiwa14(gravity: Array = (0, 0, -9.80665)) -> Mechanism:
    """The KUKA LBR iiwa 14 of the paper, modified Denavit-Hartenberg frames, without base height and flange."""
    R = [np.eye(3), _UP, _DOWN, _DOWN, _UP, _UP, _DOWN]
    r = np.zeros((7, 3))
    r[2, 1], r[4, 1] = R3, -R5
    B = [pose(np.array(R_i, dtype=float), r_i[:, None]) for R_i, r_i in zip(R, r, strict=True)]
    M = [inertia_matrix(row[0], row[1:4], symmetric(row[4:])) for row in IIWA14]
    names = [f"link{i}" for i in range(1, 8)]
    return from_screws(B, [[0, 0, 1, 0, 0, 0]] * 7, M, names=names, gravity=gravity, name="iiwa14")


def planar2r(L1: Array = 1, L2: Array = 1, m1: Array = 1, m2: Array = 1, g: Array = 9.81) -> Mechanism:
    """The planar 2R robot of the paper: point masses at the link ends, gravity along -y; symbols are values too.

    The paper prints m L^2 as the xx moment of its links; a point mass on the x axis has 0 (it never enters Q).
    """
    B = [np.eye(4, dtype=int), [[1, 0, 0, L1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]
    M = [inertia_matrix(m, [L, 0, 0], np.zeros((3, 3), dtype=int)) for m, L in ((m1, L1), (m2, L2))]
    return from_screws(B, [[0, 0, 1, 0, 0, 0]] * 2, M, gravity=[0, -g, 0], name="planar2r")


BUNDLED: dict[str, Callable[..., Mechanism]] = {"iiwa14": iiwa14, "planar2r": planar2r}
