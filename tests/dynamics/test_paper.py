"""The paper's expansions: both forms of everything, and a test for each erratum that fails with the printed form."""

from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.dynamics import paper as expansions
from jounce.dynamics import system
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.paper import Paper
from jounce.io import motions
from jounce.spatial import lie
from jounce.spatial.series import Series, column_series, from_rate
from support.refusals import refusal
from support.robots import GOLDEN_NAMES, golden, loads, random_mechanism, rates_of, relative_error

CASES = [(name, i) for name in GOLDEN_NAMES for i in range(3)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def paper(request):
    mechanism, cases = golden(request.param[0])
    q, W = rates_of(cases[request.param[1]])
    return Paper(mechanism, column_series(q), loads(W))


@pytest.fixture
def matrices(paper):
    return {
        "M": paper.M, "A": paper.A,
        "a": paper.a(), "da": paper.a(1), "d2a": paper.a(2),
        "b": paper.b(), "db": paper.b(1), "d2b": paper.b(2),
    }  # fmt: skip


def named_matrices(matrices, names):
    return {name: matrices[name] for name in names.split()}


def assert_same_matrix(x, y, tolerance=1e-13):
    assert relative_error(x, y) < tolerance


@pytest.mark.parametrize("form", [expansions.M21, expansions.M22])
def test_forms_of_m2_agree(matrices, form):
    given = named_matrices(matrices, "M A a da")
    assert_same_matrix(form(**given), expansions.M2(**given))
    assert_same_matrix(expansions.dM1_first(**given), expansions.dM1_second(**given))


def test_forms_of_c1_agree(matrices):
    given = named_matrices(matrices, "M A a da")
    C = expansions.C(**named_matrices(matrices, "M A a b"))
    dC = expansions.dC_first(**given, db=matrices["db"])
    assert_same_matrix(expansions.dC_second(**given, db=matrices["db"]), dC)
    C1 = expansions.C1(C, dC, matrices["A"], matrices["a"])
    assert_same_matrix(expansions.C11(**named_matrices(matrices, "M A a da b db")), C1)
    assert_same_matrix(expansions.C12(**named_matrices(matrices, "M A a da b db")), C1)


def test_forms_of_c2_agree(matrices):
    A, a, da, db = (matrices[k] for k in ("A", "a", "da", "db"))
    C = expansions.C(**named_matrices(matrices, "M A a b"))
    dC = expansions.dC_first(**named_matrices(matrices, "M A a da"), db=db)
    d2C = expansions.d2C_first(**named_matrices(matrices, "M A a da d2a d2b"))
    C1 = expansions.C1(C, dC, A, a)
    dC1 = expansions.dC1_first(C, dC, d2C, A, a, da)
    assert_same_matrix(expansions.d2C_second(**named_matrices(matrices, "M A a da d2a d2b")), d2C)
    assert_same_matrix(expansions.dC1_second(C, C1, d2C, A, a, da), dC1)
    C2 = expansions.C2(C1, dC1, A, a)
    for form in (expansions.C21, expansions.C22):
        assert_same_matrix(form(**named_matrices(matrices, "M A a da d2a b db d2b")), C2)


def test_expansions_are_the_rates_by_the_product_rule(paper):
    F = closed_form(paper.mechanism, paper.q, paper.W)
    for k in range(3):
        for entry in ("gM", "gC", "Qgrav", "Qext", "Q"):
            assert np.abs(getattr(paper, entry)[k] - getattr(F, entry)[k]).max() < 1e-12 * (
                1 + np.abs(getattr(F, entry)[k]).max()
            )
        assert_same_matrix((paper.V, paper.dV, paper.d2V)[k](), F.V[k], 1e-12)


def test_system_matrices_satisfy_their_definitions(paper):
    mechanism, A, a, eye = paper.mechanism, paper.A, paper.a(), np.eye(6 * paper.mechanism.nb)
    D = system.system_D(mechanism, paper.poses)
    assert_same_matrix(A, np.linalg.inv(eye - D))  # (A)
    assert np.abs(a @ system.build_system(mechanism).X).max() < 1e-14  # aX = 0
    assert np.abs(paper.b() @ paper.V()).max() < 1e-12  # bV = 0, after (Cbar)
    roots = np.zeros((6 * mechanism.nb, 6))
    for i, p in enumerate(mechanism.parent):
        if p < 0:
            roots[6 * i : 6 * i + 6] = lie.Ad(lie.inverse(paper.poses[i]))
    assert_same_matrix(A @ roots, system.system_U(paper.poses))  # (eq_U), at every root


def test_no_orders_beyond_the_printed_ones(paper):
    refusal(lambda: paper.Q[3], "order 3 needs method='closed_form'")


def test_erratum_m21_takes_q2d_in_its_first_term(matrices):
    """(M21) is printed with M^(1)(q, qd) where M^(1)(q, q2d) stands in the line before."""
    M, A, a, da = (matrices[k] for k in ("M", "A", "a", "da"))
    right = expansions.M2(M, A, a, da)
    printed = expansions.M21(M, A, a, da) - expansions.M1(M, A, da) + expansions.M1(M, A, a)
    assert relative_error(expansions.M21(M, A, a, da), right) < 1e-13
    assert relative_error(printed, right) > 1e-2


def test_erratum_m21_has_no_bound_on_its_error():
    """The printed form adds the rate of gM for qd - q2d, also where the second rate of gM vanishes, as it does here."""
    q, v = np.array([0.3, 0.7]), np.array([0.5, 1.2])
    a = np.array([0.4, -(v[1] ** 2) / np.tan(q[1])])
    robot = jounce.load("planar2r")
    M, _, M2d = robot.mass_matrix(q, v, a)
    paper = Paper(robot.mechanism, column_series([q, v, a]))
    J, given = paper.J, (paper.M, paper.A, paper.a(), paper.a(1))
    error = J.mT @ (expansions.M1(*given[:3]) - expansions.M1(*given[:2], given[3])) @ J
    assert_same_matrix(error, robot.mass_matrix(q, v - a)[1])
    assert np.abs(M2d).max() < 1e-15
    assert np.abs(error).max() > 0.1 * np.abs(M).max()


def test_erratum_m21_exceeds_480_percent_on_chains():
    """Helical, prismatic, prismatic, revolute joints: by 4.8 times the second rate of gM and more in 1 of 20 states."""
    rng = np.random.default_rng(37)
    kinds = ["helical", "prismatic", "prismatic", "revolute"]
    errors = []
    for _ in range(20):
        mechanism = random_mechanism(rng, [-1, 0, 1, 2], kinds, [1, 2, 3, 4])
        for q, v, a in rng.uniform(-1, 1, (20, 3, 4)) * [[3], [2], [3]]:
            paper = Paper(mechanism, column_series([q, v, a]))
            M, A, J = paper.M, paper.A, paper.J
            right = expansions.M21(M, A, paper.a(), paper.a(1))
            printed = right - expansions.M1(M, A, paper.a(1)) + expansions.M1(M, A, paper.a())
            errors.append(relative_error(J.mT @ printed @ J, J.mT @ right @ J))
    assert max(errors) > 10
    assert 0.02 < np.mean(np.array(errors) > 4.8) < 0.1


def test_erratum_bv_is_a_column(paper):
    """After (Cbar) bV is written as a diagonal matrix; it is a column of the brackets of the twists with themselves."""
    bV, V = paper.b() @ paper.V(), paper.V().reshape(-1, 6)
    assert bV.shape == (6 * len(V), 1)
    assert np.abs(bV).max() < 1e-12 > np.abs(lie.ad(V) @ V[..., None]).max()


def test_erratum_twists_depend_on_q():
    """(Csys) writes V(qd); with the same qd the twists differ from pose to pose."""
    robot = jounce.load("planar2r")
    V = [robot.twists([0.1, q2], [1, 1], body="body2") for q2 in (0.2, 0.9)]
    assert np.abs(V[0] - V[1]).max() > 0.1


def test_erratum_the_published_prismatic_screw_turns():
    """(e; 0) of the published code turns the body about e; (0; e) slides it along e."""
    e, zero, q = [0, 0, 1], [0, 0, 0], np.array([[0.5]])
    published, true = (lie.exp(np.array([*X[0], *X[1]], dtype=float), q) for X in ((e, zero), (zero, e)))
    assert np.abs(lie.rotation(published) - np.eye(3)).max() > 0.1
    assert not lie.position(published).any()
    np.testing.assert_array_equal(true, lie.pose(np.eye(3), np.array([[0], [0], [0.5]])))


def test_erratum_c22_begins_with_a_minus(matrices):
    """The published code has a commented-out form that begins with + M A a2d: another matrix."""
    given = named_matrices(matrices, "M A a da d2a b db d2b")
    right = expansions.C21(**given)
    published = expansions.C22(**given) + 2 * matrices["M"] @ matrices["A"] @ matrices["d2a"]
    assert_same_matrix(expansions.C22(**given), right)
    assert relative_error(published, right) > 1e-2


def test_erratum_rate_of_ad_holds_for_neighbours_only(paper):
    """Before (Adot): printed for Ad(C_ij) of any j; true for the parent, which is all that Ddot = -aD uses."""
    mechanism, h = paper.mechanism, 1e-5
    q, qd = paper.q[0], paper.q[1]
    C, ahead, behind = (system.poses(mechanism, Series.constant(q + s * h * qd), None) for s in (0, 1, -1))

    def rate(i, j):
        return (_ad(ahead, i, j) - _ad(behind, i, j)) / (2 * h)

    def printed(i, j):
        thetad = (mechanism.G @ qd)[i, 0]
        return -thetad * lie.ad(mechanism.X[i]) @ _ad(C, i, j)

    V = paper.V().reshape(-1, 6)
    for i in range(1, mechanism.nb):
        for j in range(i):
            relative = V[i] - _ad(C, i, j) @ V[j]
            general = -lie.ad(relative) @ _ad(C, i, j)
            assert np.abs(rate(i, j) - general).max() < 1e-6 * (1 + np.abs(general).max())
            if mechanism.parent[i] == j:
                assert np.abs(printed(i, j) - general).max() < 1e-12 * (1 + np.abs(general).max())
    if mechanism.name == "iiwa":
        assert np.abs(printed(6, 0) - rate(6, 0)).max() > 0.1


def _ad(C, i, j):
    return lie.Ad(lie.inverse(C[i]) @ C[j])


def test_d_solves_its_differential_equation(paper):
    """Ddot = -aD, in the text before (Adot), up to the second rate of the inverse (I - D)^-1 = A."""
    D = from_rate(system.system_D(paper.mechanism, paper.poses), lambda D: -(closed_a(paper) @ D))
    A = from_rate(paper.A, lambda A: A @ D.dot @ A)
    J = closed_form(paper.mechanism, paper.q).J
    for k in range(3):
        assert_same_matrix(A[k] @ system.build_system(paper.mechanism).X, J[k], 1e-12)


def closed_a(paper):
    return paper.q.dot.map(lambda v: system.system_a(system.build_system(paper.mechanism).X, v))


def test_erratum_skew_symmetry_needs_the_arrangement_of_cbar(paper):
    """After (Cbar): property 2) holds for every C; with (Csys), gM' - 2C itself is not skew."""
    F, qd = closed_form(paper.mechanism, paper.q), paper.q[1]
    S = F.gM[1] - 2 * F.gC[0]
    assert np.abs(qd.T @ S @ qd).max() < 1e-11 * np.abs(S).max() * np.abs(qd).max() ** 2
    if paper.mechanism.name != "planar2r":
        assert np.abs(S + S.T).max() > 0.1 * np.abs(S).max()
    Sbar = F.gM[1] - 2 * F.gCbar[0]
    assert np.abs(Sbar + Sbar.T).max() < 1e-12 * np.abs(S).max()


def test_erratum_massless_bodies_leave_m_semidefinite():
    """Section 5: M > 0 follows from M_i > 0; with semidefinite M_i it must be checked."""
    B, X = [np.eye(4)] * 2, [[0, 0, 1, 0, 0, 0], [1, 0, 0, 0, 0, 0]]
    massless = np.zeros((6, 6))
    arm = jounce.inertia_matrix(1.0, [0.3, 0, 0], np.zeros((3, 3)))
    M = jounce.Robot.from_screws(B, X, [arm, massless]).mass_matrix([0.1, 0.2])
    assert np.linalg.eigvalsh(M)[0] == 0


def test_erratum_the_third_inertia_column_is_xz():
    """Table 1 heads it Theta_yx; r3 and r5, which the paper leaves out, are 0.42 m and 0.40 m."""
    mechanism, _ = golden("iiwa")
    ours = jounce.load("iiwa14").mechanism
    np.testing.assert_allclose(ours.M, mechanism.M, rtol=1e-15, atol=1e-17)
    np.testing.assert_allclose(ours.B, mechanism.B, atol=1e-16)
    assert ours.M[3, 0, 2] != ours.M[3, 0, 1]


def test_erratum_the_published_code_leaves_out_steiners_theorem():
    """It takes inertia tensors about the COMs for ones about the frames' origins; here along the paper's motion."""
    arm = jounce.load("iiwa14")
    M = arm.mechanism.M.copy()
    for M_i in M:
        m, h = M_i[3, 3], lie.axial(M_i[:3, 3:]) / 2
        M_i[:3, :3] += lie.hat(h) @ lie.hat(h) / m
    published = jounce.Robot.from_screws(arm.mechanism.B, arm.mechanism.X, M, gravity=arm.gravity)
    motion = motions.read(Path("paper"), arm.mechanism, 4)
    rates = motion(motion.times[::10], 4)
    both = zip(published.inverse_dynamics(*rates), arm.inverse_dynamics(*rates), strict=True)
    assert [round(relative_error(*pair), 3) for pair in both] == [0.031, 0.034, 0.081]
    assert np.count_nonzero(np.linalg.eigvalsh(M)[:, 0] < 0) == 5
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (4000, 7))
    negative = [np.mean(np.linalg.eigvalsh(robot.mass_matrix(q))[:, 0] < 0) for robot in (published, arm)]
    assert 0.02 < negative[0] < 0.04
    assert negative[1] == 0
