"""Initial values: consistent accelerations and multipliers, dofs without mass, gaps and errors.

The expected values solve the equations (S1) of all subdomains as one dense system,

    [ M  -L^T ] [ w   ]   [ F(0) - C v - K u ]
    [ L    0  ] [ Lam ] = [ 0                ]

or are those of the uncut structure, or follow from a balance of forces by hand.
"""

import warnings

import numpy as np
import pytest
import reference
import scipy.linalg
import scipy.sparse as sp
from agreement import assert_close, largest
from pairwise import pairwise

import pmalpha as pm

SOFT = pm.GeneralizedAlpha(0.5)
FAST = pm.GeneralizedAlpha(0.5, explicit=True)
FORMS = {"dense": np.asarray, "csr": sp.csr_array, "csc": sp.csc_matrix, "bsr": sp.bsr_array}
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


def with_every_form(values):
    """Of these values, of the forms, and of lumped or consistent masses all pairs."""
    cases = pairwise(list(FORMS.values()), values, [False, True])
    return pytest.mark.parametrize(("form", "value", "consistent"), cases)


# Dense solves of condition number up to 1e4, in another order of sums: rounding times that.
ROUNDING = 1e-12


def kkt(subdomains, L):
    """w of each subdomain and Lam, from dicts with M, C, K, F, u0, v0 and matrices L_i."""
    M = scipy.linalg.block_diag(*(q["M"] for q in subdomains))
    Lall = np.hstack(L)
    p = len(Lall)
    r = np.concatenate([q["F"] - q["C"] @ q["v0"] - q["K"] @ q["u0"] for q in subdomains])
    matrix = np.block([[M, -Lall.T], [Lall, np.zeros((p, p))]])
    x = np.linalg.solve(matrix, np.concatenate([r, np.zeros(p)]))
    ends = np.cumsum([len(q["M"]) for q in subdomains])
    return np.split(x[: ends[-1]], ends[:-1]), x[ends[-1] :]


def subdomain(q, form=np.asarray, scheme=SOFT, **options):
    options = dict(force=q["F"], u0=q["u0"], v0=q["v0"]) | options
    return pm.Subdomain(form(q["M"]), form(q["K"]), C=form(q["C"]), scheme=scheme, **options)


def assert_initial(coupler, w, Lam):
    """The coupler starts with these accelerations and multipliers."""
    size = largest(*w)
    for i, expected in enumerate(w):
        what, found = f"initial acceleration of subdomain {i}", coupler.state(i).a
        assert_close(found[None], expected[None], ROUNDING, what, size=size)
    what, force = "initial multiplier", max(largest(Lam), size)  # masses of size 1
    found = coupler.multipliers
    assert_close(found[None], Lam[None], ROUNDING, what, size=force, column="constraint")
    # and so does a history
    history = coupler.run(steps=0)
    for i in range(len(w)):
        np.testing.assert_array_equal(history[i].a[0], coupler.state(i).a)
    np.testing.assert_array_equal(history.multipliers[0], coupler.multipliers)


def random_data(rng, n, *, consistent):
    """Matrices and load of a subdomain, without a state."""
    M = np.diag(rng.uniform(1.0, 3.0, n))
    if consistent:
        M += 0.4 * (np.eye(n, k=1) + np.eye(n, k=-1))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5)
    K = 20.0 * A @ A.T + np.eye(n)
    return {"M": M, "K": K, "C": 0.2 * M + 0.003 * K, "F": rng.normal(size=n)}


def set_states(rng, subdomains, L):
    """Random displacements and velocities, projected onto those that satisfy the constraints."""
    sizes = [len(q["M"]) for q in subdomains]
    whole = np.hstack(L)
    for name in ("u0", "v0"):
        x = rng.normal(size=sum(sizes))
        x -= np.linalg.pinv(whole) @ (whole @ x)
        for q, bar in zip(subdomains, np.split(x, np.cumsum(sizes)[:-1])):
            q[name] = bar


# ---- several subdomains ---------------------------------------------------------------------


@with_every_form(range(4))
def test_initial_accelerations_and_multipliers_solve_all_equations_at_once(form, value, consistent):
    rng = np.random.default_rng(value)
    sizes = rng.integers(2, 7, size=4)
    subdomains = [random_data(rng, int(n), consistent=consistent) for n in sizes]
    # four general constraints over all dofs of all subdomains
    L = np.split(rng.normal(size=(4, sum(sizes))), np.cumsum(sizes)[:-1], axis=1)
    set_states(rng, subdomains, L)
    schemes = SOFT, FAST, pm.HHT(0.1), pm.CentralDifference()
    made = [
        subdomain(q, form, scheme, substeps=ss)
        for q, scheme, ss in zip(subdomains, schemes, (1, 4, 2, 4))
    ]
    coupler = pm.Coupler(made, pm.Constraint(dict(zip(made, L))), dt=0.01, coupling="pm")
    w, Lam = kkt(subdomains, L)
    assert_initial(coupler, w, Lam)
    # without the multipliers they would differ
    alone = np.linalg.solve(subdomains[0]["M"], (subdomains[0]["M"] @ w[0]) - L[0].T @ Lam)
    assert np.abs(alone - w[0]).max() > 1e-3


def test_sparse_constraints_equal_dense_ones():
    rng = np.random.default_rng(5)
    subdomains = [random_data(rng, 3, consistent=True) for _ in range(2)]
    L = [rng.normal(size=(2, 3)), np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])]
    set_states(rng, subdomains, L)
    a, b = (subdomain(q) for q in subdomains)
    for to in (np.asarray, sp.csr_array, sp.coo_matrix, sp.lil_array):
        rows = pm.Constraint({a: to(L[0]), b: to(L[1])})
        coupler = pm.Coupler([a, b], rows, dt=0.01, coupling="pm")
        assert_initial(coupler, *kkt(subdomains, L))


def cross(form, consistent):
    """Four bars of three elements that meet in one point, and the uncut structure."""
    rng = np.random.default_rng(11)
    element = np.array([[1.0, -1.0], [-1.0, 1.0]])
    mass = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0 if consistent else np.eye(2) / 2.0
    M, C, K = np.zeros((3, 13, 13))
    u0, v0, F = rng.normal(size=(3, 13))
    subdomains, made = [], []
    for i in range(4):
        dofs = [0, *range(1 + 3 * i, 4 + 3 * i)]  # the point, then outwards
        bar = {name: np.zeros((4, 4)) for name in "MCK"}
        for e in range(3):
            at = np.ix_([e, e + 1], [e, e + 1])
            bar["M"][at] += (i + 1.0) * mass
            bar["K"][at] += 10.0 * (e + 1.0) * element
            bar["C"][at] += 0.1 * (i + 1.0) * element
        at = np.ix_(dofs, dofs)
        M[at] += bar["M"]
        C[at] += bar["C"]
        K[at] += bar["K"]
        share = F[dofs].copy()
        share[0] *= (0.1, 0.2, 0.3, 0.4)[i]  # the load of the point, in unequal shares
        subdomains.append({**bar, "F": share, "u0": u0[dofs], "v0": v0[dofs]})
        # a load that is called enters with its value at zero
        called = dict(force=lambda t, F=share: F * np.cos(t) + 100.0 * t) if i == 2 else {}
        how = dict(scheme=(SOFT, FAST)[i % 2], substeps=(1, 6, 2, 3)[i])
        made.append(subdomain(subdomains[-1], form, **how, **called))
    w = np.linalg.solve(M, F - C @ v0 - K @ u0)
    return subdomains, made, w


TREES = {"star": ((0, 1), (0, 2), (0, 3)), "chain": ((2, 0), (0, 3), (3, 1))}


@with_every_form(list(TREES))
def test_subdomains_that_meet_at_a_cross_point_start_as_the_uncut_structure(
    form, value, consistent
):
    tree = TREES[value]
    subdomains, made, w = cross(form, consistent)
    coupler = pm.Coupler(
        made, [pm.tie(made[i], [0], made[j], [0]) for i, j in tree], dt=0.01, coupling="pm"
    )
    L = [np.zeros((3, 4)) for _ in subdomains]
    for row, (i, j) in enumerate(tree):
        L[i][row, 0], L[j][row, 0] = 1.0, -1.0
    together, Lam = kkt(subdomains, L)
    assert_initial(coupler, together, Lam)
    for i in range(4):
        expected = w[[0, *range(1 + 3 * i, 4 + 3 * i)]]
        size = ROUNDING * np.abs(w).max()
        np.testing.assert_allclose(coupler.state(i).a, expected, rtol=0, atol=size)
    # each bar gets the force that its motion needs, for any tree of ties
    for q, bar, wi in zip(subdomains, L, together):
        force = (q["M"] @ wi + q["C"] @ q["v0"] + q["K"] @ q["u0"] - q["F"])[0]
        # a few roundings of forces up to 100
        assert (bar.T @ coupler.multipliers)[0] == pytest.approx(force, abs=1e-11)


def test_without_constraints_every_subdomain_starts_by_itself():
    subdomains, made, _ = cross(sp.csr_array, True)
    coupler = pm.Coupler(made, dt=0.01, coupling="pm")
    w = [np.linalg.solve(q["M"], q["F"] - q["C"] @ q["v0"] - q["K"] @ q["u0"]) for q in subdomains]
    assert_initial(coupler, w, np.zeros(0))


def test_a_constraint_on_one_subdomain_alone_is_a_support():
    q = random_data(np.random.default_rng(3), 3, consistent=True)
    q["u0"], q["v0"] = np.zeros(3), np.array([0.0, 1.0, 0.0])
    s = subdomain(q)
    L = [np.array([[1.0, 0.0, -2.0]])]
    coupler = pm.Coupler([s], pm.Constraint({s: L[0]}), dt=0.01)
    assert_initial(coupler, *kkt([q], L))
    assert coupler.run(steps=20)[0].v @ L[0][0] == pytest.approx(0.0, abs=1e-13)  # v of size 1


def test_masses_a_million_million_million_times_apart_are_both_masses():
    light = pm.Subdomain([1e-14], [1.0], scheme=SOFT, u0=[1e-14], name="light")
    heavy = pm.Subdomain([1e6], [1.0], scheme=SOFT, u0=[1.0], name="heavy")
    coupler = pm.Coupler([light, heavy], dt=1e-9, coupling="pm")
    # w = - k u / m, two roundings
    np.testing.assert_allclose(coupler.state("light").a, [-1.0], rtol=1e-15)
    np.testing.assert_allclose(coupler.state("heavy").a, [-1e-6], rtol=1e-15)


def test_a_structure_at_rest_without_loads_starts_and_stays_at_zero():
    _, made, _ = cross(sp.csr_array, True)
    still = [pm.Subdomain(s.M, s.K, C=s.C, scheme=s.scheme, substeps=s.substeps) for s in made]
    history = pm.Coupler(
        still, [pm.tie(still[0], [0], s, [0]) for s in still[1:]], dt=0.01, coupling="pm"
    ).run(steps=5)
    for subdomain in history.subdomains:
        assert not subdomain.u.any() and not subdomain.v.any() and not subdomain.a.any()
    assert not history.multipliers.any()


# ---- dofs without mass ----------------------------------------------------------------------

K_SERIES = np.array([[100.0, -70.0], [-70.0, 70.0]])  # ground - 30 - dof 0 - 70 - dof 1


@every_form
def test_a_massless_dof_inside_is_static_condensation(form):
    # 100 u0 = 70 u1 at all times; 30 and 70 in series are 21
    s = pm.Subdomain(form(np.diag([0.0, 2.0])), form(K_SERIES), scheme=SOFT, u0=[0.7, 1.0])
    one = pm.Subdomain([2.0], [21.0], scheme=SOFT, u0=[1.0])
    whole, condensed = (pm.solve(x, dt=0.1, steps=200) for x in (s, one))
    # no equation determines its acceleration at t = 0: zero. The mass has - 21 / 2
    assert whole.a[0, 0] == 0.0
    np.testing.assert_allclose(whole.a[0, 1], -10.5, rtol=1e-15)  # 0.7 is rounded
    # rounding of a = 10 over 200 steps, as in the two displacements
    np.testing.assert_allclose(whole.u[:, 1:], condensed.u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(whole.u[:, :1], 0.7 * condensed.u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(whole.a[:, 1:], condensed.a, rtol=0, atol=1e-11)
    # the effect of w_0 = 0 decays like n^2 rho^n: 60^2 2^-60 = 3e-15 of a velocity of 3
    assert abs(whole.v[1, 0] - 0.7 * condensed.v[1, 0]) > 1e-2
    np.testing.assert_allclose(whole.v[60:, :1], 0.7 * condensed.v[60:], rtol=0, atol=1e-12)


@every_form
def test_several_massless_dofs_inside_are_condensed_in_a_coupled_structure(form):
    # dofs 1 and 3 of a chain of five have no mass; dof 4 is tied. Condensed: 0, 2, 4 remain
    K = 50.0 * (2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
    m, s = [0, 2, 4], [1, 3]
    M = np.diag([1.0, 0.0, 2.0, 0.0, 0.5])
    shape = -np.linalg.solve(K[np.ix_(s, s)], K[np.ix_(s, m)])
    condensed = K[np.ix_(m, m)] + K[np.ix_(m, s)] @ shape
    u_m = np.array([0.4, -0.1, 0.3])
    u = np.zeros(5)
    u[m], u[s] = u_m, shape @ u_m
    other = {"scheme": FAST, "substeps": 2, "u0": [0.3]}
    histories = []
    for mass, stiff, start, last in (
        (form(M), form(K), u, 4), (M[np.ix_(m, m)], condensed, u_m, 2)
    ):  # fmt: skip
        a = pm.Subdomain(mass, stiff, scheme=SOFT, u0=start)
        b = pm.Subdomain([1.5], [60.0], **other)
        histories.append(
            pm.Coupler([a, b], pm.tie(a, [last], b, [0]), dt=0.02, coupling="pm").run(steps=100)
        )
    whole, small = histories
    # rounding of a = 50 over 200 fine steps
    np.testing.assert_allclose(whole[0].u[:, m], small[0].u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(whole[0].u[:, s], small[0].u @ shape.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(whole[0].a[:, m], small[0].a, rtol=0, atol=1e-10)
    np.testing.assert_allclose(whole.multipliers, small.multipliers, rtol=0, atol=1e-10)
    assert not whole[0].a[0, s].any()


@every_form
def test_a_massless_dof_on_the_interface_follows_the_constraint(form):
    # ground - 30 - [a] tied to [b0 - 70 - b1]; a has no mass
    a = pm.Subdomain([0.0], [30.0], scheme=SOFT, u0=[1.0], name="a")
    K = 70.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    b = pm.Subdomain(form(np.diag([0.5, 2.0])), form(K), scheme=SOFT, u0=[1.0, 2.0], name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.01, coupling="pm")
    # row of a: Lam = 30 * 1. Row of b0: 0.5 w = 70 - 30. Row of b1: 2 w = - 70
    assert_initial(coupler, [np.array([80.0]), np.array([80.0, -35.0])], np.array([30.0]))


@with_every_form(range(4))
def test_massless_dofs_in_general_constraints_solve_all_equations_at_once(form, value, consistent):
    rng = np.random.default_rng(100 + value)
    subdomains = [random_data(rng, n, consistent=consistent) for n in (4, 3, 5)]
    # one massless dof of subdomain 0 and two of 2, each in constraints with dofs that have mass
    for i, dof in ((0, 1), (2, 0), (2, 3)):
        for name in "MC":
            subdomains[i][name][dof, :] = subdomains[i][name][:, dof] = 0.0
    L = np.split(rng.normal(size=(4, 12)), [4, 7], axis=1)
    set_states(rng, subdomains, L)
    schemes = SOFT, FAST, pm.HHT(0.2)
    made = [subdomain(q, form, scheme) for q, scheme in zip(subdomains, schemes)]
    coupler = pm.Coupler(made, pm.Constraint(dict(zip(made, L))), dt=0.01, coupling="pm")
    assert_initial(coupler, *kkt(subdomains, L))


@every_form
def test_two_massless_dofs_tied_to_each_other_carry_the_force_and_do_not_accelerate(form):
    # ground - 20 - a1 | b0 - 40 - b1: the interface is at a joint without mass
    K_a = np.array([[50.0, -20.0], [-20.0, 20.0]])
    K_b = 40.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    # a0 = 0.5, b1 = 2 and the joint between them in equilibrium: 20 (j - 0.5) = 40 (2 - j)
    j = 1.5
    a = pm.Subdomain(form(np.diag([1.0, 0.0])), form(K_a), scheme=SOFT, u0=[0.5, j], name="a")
    b = pm.Subdomain(form(np.diag([0.0, 3.0])), form(K_b), scheme=SOFT, u0=[j, 2.0], name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=0.01, coupling="pm")
    # the force 20 pulls the joint back in a, so Lam = 20; no equation determines its acceleration
    w_a, w_b = np.array([-(25.0 - 30.0), 0.0]), np.array([0.0, -20.0 / 3.0])
    assert_initial(coupler, [w_a, w_b], np.array([20.0]))
    assert not coupler.state("a").a[1] and not coupler.state("b").a[0]


def test_a_structure_cut_at_a_massless_joint_moves_as_the_condensed_one():
    K_a = np.array([[50.0, -20.0], [-20.0, 20.0]])
    K_b = 40.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    # condensed: springs 20 and 40 in series are 40 / 3
    k = 40.0 / 3.0
    M, K = np.diag([1.0, 3.0]), np.array([[30.0 + k, -k], [-k, k]])
    truth = reference.exact(M, None, K, [0.5, 2.0], None, 1.0)[0]
    errors = []
    for count in (400, 800):
        a = pm.Subdomain([1.0, 0.0], K_a, scheme=SOFT, u0=[0.5, 1.5])
        b = pm.Subdomain([0.0, 3.0], K_b, scheme=SOFT, u0=[1.5, 2.0])
        history = pm.Coupler([a, b], pm.tie(a, [1], b, [0]), dt=1 / count, coupling="pm").run(1.0)
        errors.append(np.abs([history[0].u[-1, 0], history[1].u[-1, 1]] - truth).max())
    # order 2 with equal steps; dt omega = 0.02: the next term
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_three_massless_dofs_at_a_cross_point_and_one_with_mass_all_follow_the_mass():
    subdomains = [pm.Subdomain([0.0], [k], scheme=SOFT, u0=[1.0]) for k in (1.0, 2.0, 3.0)]
    subdomains.append(pm.Subdomain([2.0], [4.0], scheme=FAST, u0=[1.0], substeps=2))
    ties = [pm.tie(subdomains[i], [0], subdomains[i + 1], [0]) for i in range(3)]
    coupler = pm.Coupler(subdomains, ties, dt=0.01, coupling="pm")
    # Lam of tie i carries the springs 0..i; the mass has w = - (1 + 2 + 3 + 4) / 2
    assert_initial(coupler, [np.array([-5.0])] * 4, np.array([1.0, 3.0, 6.0]))


def test_three_massless_dofs_tied_in_a_row_share_the_balance_and_do_not_accelerate():
    loads = (5.0, -2.0, -3.0)
    subdomains = [pm.Subdomain([0.0], [1.0], scheme=SOFT, force=[f]) for f in loads]
    ties = [pm.tie(subdomains[i], [0], subdomains[i + 1], [0]) for i in range(2)]
    coupler = pm.Coupler(subdomains, ties, dt=0.01, coupling="pm")
    # 0 = F + L^T Lam from the left: Lam = -5, then -5 + 2; no equation determines w
    assert_initial(coupler, [np.zeros(1)] * 3, np.array([-5.0, -3.0]))


@pytest.mark.gate
def test_massless_dofs_that_a_row_leaves_free_have_the_smallest_accelerations():
    # 0 = b_k lam, so lam = 0 and m w = F; one row, b . w_m = - c w, for three accelerations w_m.
    # Rounding decides whether a pivot is exactly zero
    rng = np.random.default_rng(2)
    for _ in range(12):
        b, c, F = rng.normal(size=3), rng.normal(), rng.normal()
        mass = pm.Subdomain([2.0], [1.0], scheme=SOFT, force=[F], name="mass")
        light = [pm.Subdomain([0.0], [1.0], scheme=SOFT, name=str(k)) for k in range(3)]
        rows = {mass: [[c]]} | {s: [[x]] for s, x in zip(light, b)}
        coupler = pm.Coupler([mass, *light], pm.Constraint(rows), dt=0.1, coupling="pm")
        w = [coupler.state(s.name).a[0] for s in (mass, *light)]
        # w_m of least norm with b . w_m = - c w
        expected = [F / 2.0, *(-c * F / 2.0 * b / (b @ b))]
        assert w == pytest.approx(expected, abs=ROUNDING * max(1.0, abs(c)) / np.max(np.abs(b)))


@every_form
def test_a_massless_row_that_is_not_in_equilibrium_warns_with_dof_and_amount(form):
    # row of dof 0: 100 u0 - 70 u1 = 3 for u0 = 0.73
    s = pm.Subdomain(
        form(np.diag([0.0, 2.0])), form(K_SERIES), scheme=SOFT, u0=[0.73, 1.0], name="spring"
    )
    with pytest.warns(pm.ConstraintWarning, match=r"dof 0 of 'spring'.*\b3 is left"):
        coupler = pm.Coupler([s], dt=0.1)
    # the first step jumps to equilibrium: rounding of forces of 70
    left = coupler.run(steps=3)[0].u @ K_SERIES[0]
    assert left == pytest.approx([3.0, 0.0, 0.0, 0.0], abs=1e-12)
    # dof 1 too when the load is evaluated later
    s = pm.Subdomain(
        form(np.diag([2.0, 0.0])), form(K_SERIES), scheme=SOFT, name="late",
        force=lambda t: np.array([0.0, 1.0]),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coupler = pm.Coupler([s], dt=0.1)
    with pytest.warns(pm.ConstraintWarning, match=r"dof 1 of 'late'.*\b1 is left"):
        coupler.step()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15])
def test_equilibrium_of_massless_rows_is_checked_relative_to_the_forces(scale):
    def make(off):
        u0 = scale * np.array([0.7 + off, 1.0])
        return pm.Coupler([pm.Subdomain([0.0, 2.0], K_SERIES, scheme=SOFT, u0=u0)], dt=0.1)

    make(1e-12)  # rounding of what was computed: no warning, which would be an error here
    with pytest.warns(pm.ConstraintWarning, match="dof 0"):
        make(1e-5)


def test_massless_dofs_tied_to_each_other_out_of_balance_warn():
    subdomains = [pm.Subdomain([0.0], [1.0], scheme=SOFT, force=[f]) for f in (5.0, -2.0)]
    with pytest.warns(pm.ConstraintWarning, match="without mass"):
        coupler = pm.Coupler(
            subdomains, pm.tie(subdomains[0], [0], subdomains[1], [0]), dt=0.1, coupling="pm"
        )
    assert np.isfinite(coupler.run(steps=50)[0].u).all()


def test_the_equilibrium_of_a_massless_row_includes_its_damping():
    # c v + k u = F: 2 * 3 + 5 * 4 = 26
    C, K = np.diag([2.0, 0.0]), np.diag([5.0, 1.0])
    options = {"scheme": SOFT, "u0": [4.0, 0.0], "v0": [3.0, 0.0]}
    pm.Coupler([pm.Subdomain([0.0, 1.0], K, C=C, force=[26.0, 0.0], **options)], dt=0.1)
    with pytest.warns(pm.ConstraintWarning, match=r"dof 0.*\b6 is left"):
        pm.Coupler([pm.Subdomain([0.0, 1.0], K, C=C, force=[20.0, 0.0], **options)], dt=0.1)


# ---- gaps and inconsistent velocities -------------------------------------------------------


def three(u0=None, v0=None, force=None, weight=1.0):
    """Three subdomains of two dofs, tied in a row by two constraints: rows 0, 1 and row 2."""
    starts = [
        {name: x[i] for name, x in (("u0", u0), ("v0", v0)) if x is not None and i < len(x)}
        for i in range(3)
    ]
    a, b = (
        pm.Subdomain([1.0, 2.0], [5.0, 7.0], scheme=SOFT, substeps=1 + i, name=name, force=force,
                     **starts[i])
        for i, name in enumerate(("left", "middle"))
    )  # fmt: skip
    c = pm.Subdomain([1.0], [2.0], scheme=SOFT, name="right", **starts[2])
    row = pm.Constraint({b: [[weight, 0.0]], c: [[-weight]]})
    return pm.Coupler([a, b, c], [pm.tie(a, [0, 1], b, [1, 0]), row], dt=0.1, coupling="pm")


def test_a_gap_in_the_displacements_warns_with_row_and_amount_and_persists():
    # row 0: left 0 against middle 1; row 2: middle 0 against right 0
    u0 = [1.0, 0.25], [0.25, 0.5]
    with pytest.warns(pm.ConstraintWarning) as caught:
        coupler = three(u0=u0)
    text = str(caught[0].message)
    assert len(caught) == 1 and "gap" in text
    assert "0 (row 0 of constraint 0): 0.5" in text and "2 (row 0 of constraint 1): 0.25" in text
    assert "row 1" not in text
    history = coupler.run(steps=20)
    np.testing.assert_array_equal(history.displacement_jump[0], [0.5, 0.0, 0.25])
    # velocities are tied: the gap changes by O(dt^2) only, 0.1^2 of displacements below 1
    assert np.abs(history.displacement_jump - [0.5, 0.0, 0.25]).max() < 0.05


@pytest.mark.parametrize("force", [None, lambda t: np.zeros(2)], ids=["none", "callable"])
def test_a_gap_warns_once_when_the_coupler_is_made_and_again_when_it_is_reset(force):
    # the initial displacements are known before any load is evaluated
    with pytest.warns(pm.ConstraintWarning, match=r"row 0 .*: 1\b"):
        coupler = three(u0=([1.0, 0.0], [0.0, 0.0]), force=force)
    coupler.run(steps=1)  # a second warning would be an error here
    closed = {"left": [0.0, 2.0], "middle": [2.0, 0.0], "right": [2.0]}
    coupler.reset(u0=closed)
    with pytest.warns(pm.ConstraintWarning, match=r"row 1 .*: 2\b"):
        coupler.reset(u0={**closed, "left": [0.0, 4.0]})


def test_velocities_that_violate_a_constraint_raise_with_row_and_amount():
    with pytest.raises(pm.ConstraintError) as caught:
        three(v0=([1.0, 0.25], [0.25, 0.5]))
    text = str(caught.value)
    assert isinstance(caught.value, ValueError) and "v0" in text
    assert "0 (row 0 of constraint 0) by 0.5" in text
    assert "2 (row 0 of constraint 1) by 0.25" in text
    assert "row 1 of" not in text


def test_velocities_that_violate_the_only_constraint_name_its_row():
    a, b = (pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=SOFT, v0=v) for v in ([1, 2], [1, 2.5]))
    with pytest.raises(pm.ConstraintError, match=r"rows? 1 by -0\.5"):
        pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.1, coupling="pm")


def refused(name, row):
    """Inconsistent velocities are an error, displacements a warning."""
    if name == "v0":
        return pytest.raises(pm.ConstraintError, match=row)
    return pytest.warns(pm.ConstraintWarning, match=row)


@pytest.mark.parametrize(("name", "scale"), pairwise(["u0", "v0"], [1e-30, 1.0, 1e20]))
def test_constraints_at_the_start_are_checked_relative_to_the_initial_values(name, scale):
    def make(off):
        values = scale * np.array([1.0, 0.0]), scale * np.array([0.0, 1.0 + off])
        return three(**{name: values})

    make(1e-13)  # rounding of what was computed
    with refused(name, "row 0 of constraint 0"):
        make(1e-6)


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e20])
def test_the_end_of_a_pulse_far_from_the_interface_violates_nothing(scale):
    pulse = scale * np.exp(-(np.linspace(6.1, 0.0, 40) ** 2))  # 7e-17 of its top at the interface
    bar, other = (
        pm.Subdomain(np.ones(40), pm.structures.chain(40, 1.0, 1.0).K, scheme=SOFT, v0=v0)
        for v0 in (pulse, None)
    )
    pm.Coupler([bar, other], pm.tie(bar, 0, other, 0), dt=0.1, coupling="pm")
    with pytest.raises(pm.ConstraintError, match="row 0"):
        pm.Coupler([bar, other], pm.tie(bar, 10, other, 0), dt=0.1, coupling="pm")


# values of left, middle and right that violate one row each: tie of left 1, the other constraint
BROKEN = {
    "row 1 of constraint 0": ([1.0, 2.0], [2.5, 1.0], [2.5]),
    "row 0 of constraint 1": ([1.0, 2.0], [2.0, 1.0], [2.5]),
}


@pytest.mark.parametrize(
    ("name", "row", "weight"),
    pairwise(["u0", "v0"], list(BROKEN), [1e-150, 1e-12, 1.0, 1e12, 1e150]),
)
def test_a_constraint_times_a_factor_is_checked_as_before(name, row, weight):
    three(**{name: ([1.0, 2.0], [2.0, 1.0], [2.0])}, weight=weight)
    with refused(name, row):
        three(**{name: BROKEN[row]}, weight=weight)


def test_velocities_on_dofs_in_no_constraint_are_free():
    a, b = (pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=SOFT, v0=v) for v in ([1, 2], [9, 1]))
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [1]), dt=0.1, coupling="pm")
    np.testing.assert_array_equal(coupler.state(1).v, [9.0, 1.0])
