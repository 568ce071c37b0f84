"""`drift="removed"`: displacements tied under gc, (V1) to (V5) of docs/method.md."""

import re

import numpy as np
import pytest
import reference
import scipy.sparse as sp
from agreement import assert_close, assert_motion_agrees, assert_small, largest
from pairwise import pairwise
from scipy.integrate import solve_ivp

import pmalpha as pm
from pmalpha import analysis
from pmalpha.setup import interface, tied

ALPHA = pm.GeneralizedAlpha
# Drifting subdomains are allowed to be coarse here, and some schemes have no damping.


def random_loop(rho, substeps, explicit, seed=0, n=5, form=np.asarray, **options):
    """Three random subdomains in a loop of ties, for the package and for the reference."""
    rng = np.random.default_rng(seed)
    ours, theirs = [], []
    for i, (s, e) in enumerate(zip(substeps, explicit)):
        A = rng.normal(size=(n, n))
        K, M = A @ A.T + np.eye(n), np.diag(rng.uniform(0.5, 2.0, n))
        C, u0, v0 = 0.05 * K, rng.normal(size=n), rng.normal(size=n)
        u0[[0, n - 1]], v0[[0, n - 1]] = 0.3, 0.2
        scheme = ALPHA(rho, explicit=bool(e))
        ours.append(
            pm.Subdomain(
                form(M), form(K), form(C), scheme=scheme, substeps=s, u0=u0, v0=v0, name=str(i)
            )
        )
        parameters = reference.alpha(rho, bool(e))
        theirs.append(reference.Subdomain(M, K, C, **parameters, substeps=s, u0=u0, v0=v0))
    ends = [(0, n - 1, 1, 0), (1, n - 1, 2, 0), (2, n - 1, 0, 0)]
    L = [np.zeros((3, n)) for _ in range(3)]
    for row, (i, j, k, m) in enumerate(ends):
        L[i][row, j], L[k][row, m] = 1.0, -1.0
    ties = [pm.tie(ours[i], j, ours[k], m) for i, j, k, m in ends]
    return (ours, ties), (theirs, L)


def coupled(ours, dt=0.1, drift="removed", **options):
    return pm.Coupler(*ours, dt=dt, coupling="gc", drift=drift, **options)


def assert_agrees(history, expected, tolerance=1e-12):
    """1e-12: the rounding of some hundred steps with a condition number of a hundred."""
    assert_motion_agrees(history, expected, tolerance)
    force, at = largest(expected.multipliers), {"times": history.multiplier_times}
    got, wanted = history.multipliers, expected.multipliers
    assert_close(got, wanted, tolerance, "multiplier", size=force, column="constraint", **at)


def assert_tied(history, within):
    for what in ("displacement jump", "velocity jump"):
        jump = getattr(history, what.replace(" ", "_"))
        assert_small(jump, within, what, column="constraint")


# ---- the equations -----------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize(
    ("rho", "substeps", "explicit", "form"),
    pairwise(
        [0.0, 0.5, 1.0],
        [(1, 1, 1), (1, 2, 4), (1, 3, 6)],
        [(0, 0, 0), (0, 0, 1), (1, 1, 1)],
        [np.asarray, sp.csr_array],
    ),
)
def test_core_and_reference_agree(rho, substeps, explicit, form):
    ours, theirs = random_loop(rho, substeps, explicit, form=form)
    history = coupled(ours).run(steps=20)
    # rounding of the displacements, which are of order one
    assert_tied(history, 1e-14)
    assert_agrees(history, reference.run(*theirs, 0.1, 20, drift="removed"))
    if substeps != (1, 1, 1):
        assert largest(coupled(ours, drift="kept").run(steps=20).displacement_jump) > 1e-3


def chain_of_many(count=24):
    """Small subdomains one after the other, with alternating substeps: a sparse H."""
    rng = np.random.default_rng(5)
    ours, theirs, L = [], [], []
    for i in range(count):
        K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
        M, v0 = np.diag(rng.uniform(0.5, 2.0, 3)), np.array([0.1, rng.normal(), 0.1])
        s = 1 + i % 2
        ours.append(pm.Subdomain(M, K, scheme=ALPHA(0.5), substeps=s, v0=v0, name=str(i)))
        theirs.append(reference.Subdomain(M, K, **reference.alpha(0.5), substeps=s, v0=v0))
        L.append(np.zeros((count - 1, 3)))
    for row in range(count - 1):
        L[row][row, 2], L[row + 1][row, 0] = 1.0, -1.0
    ties = [pm.tie(a, 2, b, 0) for a, b in zip(ours, ours[1:])]
    return (ours, ties), (theirs, L)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_sparse_interface_matrix_gives_the_same(sparse, monkeypatch):
    monkeypatch.setattr(interface, "DENSE_SHARE", 1.0 if sparse else 0.0)
    ours, theirs = chain_of_many()
    taken = []
    real = tied.lu_factors
    monkeypatch.setattr(tied, "lu_factors", lambda A, p: taken.append(A) or real(A, p))
    history = coupled(ours, 0.3).run(steps=8)
    p = history.multipliers.shape[1]
    assert taken[0].shape == ((2 * p, 2 * p) if sparse else (p, p))
    assert_agrees(history, reference.run(*theirs, 0.3, 8, drift="removed"))
    assert largest(history.displacement_jump) < 1e-15


def explicit_bars(rows, rho, substeps):
    """Two explicit sheets of springs and masses tied along an edge of this number of masses."""

    def sheet(columns, s, v, name):
        grid = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(rows, rows))
        across = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(columns, columns))
        K = sp.kron(sp.eye_array(columns), grid) + sp.kron(across, sp.eye_array(rows))
        scheme = ALPHA(rho, explicit=True)
        v0 = np.zeros(rows * columns)
        v0[rows : 2 * rows] = v
        return pm.Subdomain(np.ones(rows * columns), K, scheme=scheme, substeps=s, v0=v0, name=name)

    v = np.sin(np.arange(rows))
    a, b = sheet(3, 1, v, "a"), sheet(4, substeps, -v, "b")
    return [a, b], pm.tie(a, np.arange(rows), b, np.arange(rows))


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("rho, substeps", [(0.5, 1), (0.5, 4), (1.0, 2)])
def test_a_wide_explicit_interface_keeps_sparse_matrices(rho, substeps):
    """With rho < 1 S_mu has the pattern of K on the interface, where the steps differ."""
    rows = 300
    ours = explicit_bars(rows, rho, substeps)
    coupler = coupled(ours, 0.2)
    diagonal, lower, upper, *_ = tied.displacement_factors(coupler._session.members, rows)
    assert diagonal.size == rows
    assert lower[2].size + upper[2].size < 20 * rows  # of a tridiagonal matrix
    history = coupler.run(steps=50)
    assert largest(history.displacement_jump) < 1e-15
    kept = coupled(ours, 0.2, drift="kept").run(steps=50)
    if substeps > 1:
        assert largest(kept.displacement_jump) > 1e-4


def test_an_estimated_restoring_force_is_as_a_stiffness():
    """With the exact K_r, (R2) is (7), shifted or not; 1e-12 as above."""
    (ours, ties), _ = random_loop(0.5, (1, 2, 4), (0, 0, 0))
    history = coupled((ours, ties)).run(steps=20)
    own = ours[0]
    half = 0.5 * own.K
    ours[0] = pm.Subdomain(
        own.M,
        half,
        own.C,
        scheme=own.scheme,
        restoring=lambda u, v, t: half @ u,
        restoring_stiffness=half,
        u0=own.u0,
        v0=own.v0,
        name="0",
    )
    ends = [(0, 4, 1, 0), (1, 4, 2, 0), (2, 4, 0, 0)]
    ties = [pm.tie(ours[i], j, ours[k], m) for i, j, k, m in ends]
    restored = coupled((ours, ties)).run(steps=20)
    assert largest(restored["0"].u - history["0"].u) < 1e-12
    assert largest(restored["2"].a - history["2"].a) < 1e-11
    assert largest(restored.displacement_jump) < 1e-14


# ---- properties --------------------------------------------------------------------------------


def split_oscillator(b1, substeps, schemes, share, drift="removed"):
    """Masses with mA/mB = b1 and springs with kB/kA = b1; dt is this share of the limit of B."""
    mB, kA = 1.0 / (1.0 + b1), 1.0 / (1.0 + b1)
    B = pm.Subdomain([mB], [b1 * kA], scheme=schemes[1], substeps=substeps, v0=[1.0], name="B")
    limit = analysis.critical_step(B)
    limit = 2.0 * np.sqrt(mB / (b1 * kA)) if np.isinf(limit) else limit
    A = pm.Subdomain([b1 * mB], [kA], scheme=schemes[0], v0=[1.0], name="A")
    ties = pm.tie(A, 0, B, 0)
    return pm.Coupler([A, B], ties, dt=share * substeps * limit, coupling="gc", drift=drift)


def radius(coupler):
    return analysis.spectral_radius(analysis.amplification_matrix(coupler))


@pytest.mark.parametrize(
    "schemes",
    [
        *((ALPHA(rho), ALPHA(rho, explicit=True)) for rho in (0.0, 0.5, 0.8)),
        (ALPHA(0.5), pm.CentralDifference()),
        (ALPHA(0.9), ALPHA(0.9)),
    ],
)
def test_no_step_grows_where_no_warning_is_given(schemes):
    """1 + 1e-7: double eigenvalues of modulus one are computed to the root of the rounding.

    tests/coupling_survey.py has more of these problems.
    """
    for b1 in (0.01, 1.0, 100.0):
        for substeps in (1, 5):
            for share in (0.3, 0.97):
                assert radius(split_oscillator(b1, substeps, schemes, share)) < 1.0 + 1e-7


@pytest.mark.parametrize(
    "schemes",
    [
        (pm.Newmark(), pm.CentralDifference(), 3.519, 2, 0.82, "and explicit ones"),
        (ALPHA(0.8), pm.CentralDifference(), 3.519, 2, 0.82, "and explicit ones"),
        (pm.CentralDifference(), pm.Newmark(), 20.291, 8, 2.2, "fewer"),
        (pm.CentralDifference(), pm.CentralDifference(), 16.97, 20, 0.765, "fewer"),
        (pm.Newmark(), pm.Newmark(), 0.572, 2, 1.19, "several"),
    ],
)
def test_steps_that_grow_are_warned_of(schemes):
    *schemes, b1, substeps, share, word = schemes
    with pytest.warns(pm.StabilityWarning, match=word) as caught:
        coupler = split_oscillator(b1, substeps, schemes, share)
    assert radius(coupler) > 1.001
    (warning,) = caught
    stated = re.search(r"here by a factor of (\S+) in a macro step", str(warning.message))
    # three digits of what the factor adds
    np.testing.assert_allclose(float(stated[1]) - 1.0, radius(coupler) - 1.0, rtol=5.1e-3)
    assert radius(split_oscillator(b1, substeps, schemes, share, "kept")) < 1.0 + 1e-7


@pytest.mark.parametrize(
    ("schemes", "dt"),
    [((pm.Newmark(), pm.CentralDifference()), 0.3), ((pm.CentralDifference(), ALPHA(0.5)), 0.5)],
)
def test_steps_that_could_grow_and_do_not_are_not_warned_of(schemes, dt):
    """Warnings are errors here."""
    made = [
        pm.Subdomain([1.0], [1.0], scheme=schemes[0], name="A"),
        pm.Subdomain([1.0], [2.0], scheme=schemes[1], substeps=2, name="B"),
    ]
    coupler = coupled((made, pm.tie(made[0], 0, made[1], 0)), dt)
    assert radius(coupler) < 1.0 + 1e-7


def driven_shaft(schemes, dt, circulatory):
    """A shaft of two masses with inner damping: K is unsymmetric, and the whirl grows."""
    made = []
    for k, scheme in enumerate(schemes):
        K = 2.0 * np.eye(2) + circulatory * np.array([[0.0, 1.0], [-1.0, 0.0]])
        options = dict(scheme=scheme, symmetric=False, substeps=2 - k, name="AB"[k])
        made.append(pm.Subdomain(np.ones(2), K, 0.02 * np.eye(2), **options))
    return coupled((made, pm.tie(made[0], [0, 1], made[1], [0, 1])), dt)


def test_growth_of_the_structure_itself_is_not_that_of_the_steps():
    """Warnings are errors here."""
    coupler = driven_shaft((ALPHA(0.5), ALPHA(0.5)), 0.1, 0.4)
    # u'' + 0.02 u' + (2 - 0.4 i) u = 0 for u_x + i u_y
    exact = np.exp(0.1 * np.max(np.roots([1.0, 0.02, 2.0 - 0.4j]).real))
    assert exact > 1.01
    # the damping of the scheme takes a twentieth of it at 44 steps a period
    np.testing.assert_allclose(np.log(radius(coupler)), np.log(exact), rtol=0.1)


def test_growth_that_the_steps_add_to_that_of_a_structure_is_warned_of():
    with pytest.warns(pm.StabilityWarning, match="of which .* is the growth of the structure"):
        coupler = driven_shaft((pm.Newmark(), pm.CentralDifference()), 1.4, 0.06)
    exact = np.exp(1.4 * np.max(np.roots([1.0, 0.02, 2.0 - 0.06j]).real))
    assert radius(coupler) > 1.02 > exact


def test_subdomains_without_constraints_are_not_warned_of():
    made = [pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), substeps=s) for s in (1, 2)]
    pm.Coupler(made, dt=0.3, coupling="gc", drift="removed")


def oscillator_error(substeps, n, drift):
    A = pm.Subdomain([10 / 11], [1 / 11], scheme=ALPHA(0.5), v0=[6.0], name="A")
    B = pm.Subdomain(
        [1 / 11],
        [10 / 11],
        scheme=ALPHA(0.5, explicit=True),
        substeps=substeps,
        v0=[6.0],
        name="B",
    )
    coupler = pm.Coupler([A, B], pm.tie(A, 0, B, 0), dt=6.0 / n, coupling="gc", drift=drift)
    history = coupler.run(6.0)
    t = history["A"].t[:, None]
    return largest(history["A"].v - 6.0 * np.cos(t)), largest(history["A"].u - 6.0 * np.sin(t))


@pytest.mark.parametrize("substeps", [1, 2, 20])
def test_errors_and_orders_are_those_with_drift(substeps):
    removed, kept = (
        np.array([oscillator_error(substeps, n, drift) for n in (160, 320)])
        for drift in ("removed", "kept")
    )
    order = np.log2(removed[0] / removed[1])
    assert np.all(np.abs(order - np.log2(kept[0] / kept[1])) < 0.1)
    assert np.abs(removed[1, 0] / kept[1, 0] - 1.0) < 0.05


def test_an_initial_gap_stays_and_prescribed_motion_is_integrated():
    def g(t):
        return np.array([0.3 * np.sin(2.0 * t) ** 2])

    K = np.array([[9.0, -9.0], [-9.0, 9.0]])
    a = pm.Subdomain([1.0, 2.0], K, scheme=ALPHA(0.5), u0=[0.0, 0.1], name="a")
    b = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5), substeps=4, u0=[0.3], name="b")
    support = pm.Constraint({a: [[1.0, 0.0]]}, velocity=g)
    with pytest.warns(pm.ConstraintWarning, match="row 1"):
        coupler = coupled(([a, b], [support, pm.tie(a, 1, b, 0)]), 0.05)
    history = coupler.run(steps=100)
    t = np.arange(401) / 4 * 0.05
    velocity = 0.3 * np.sin(2.0 * t) ** 2
    driven = np.cumsum(np.r_[0.0, 0.5 * (velocity[1:] + velocity[:-1]) * 0.0125])[::4]  # (V5)
    assert largest(history.displacement_jump[:, 0] - driven) < 1e-14
    assert largest(history.displacement_jump[:, 1] + 0.2) < 1e-14


def test_prescribed_motion_has_its_order():
    """A driven two-dof chain cut in two, against an adaptive integration; substeps: order 1."""

    def g(t):
        return np.array([np.sin(2.0 * t) ** 2])

    def slope(t, y):  # u_0, u_1, v_1
        v = g(t)[0]
        return [v, y[2], (-9.0 * (y[1] - y[0]) - 4.0 * y[1]) / 2.0]

    exact = solve_ivp(slope, (0.0, 2.0), [0.0, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14).y
    errors = []
    for n in (100, 200):
        K = np.array([[9.0, -9.0], [-9.0, 9.0]])
        a = pm.Subdomain([1.0, 1.0], K, scheme=ALPHA(0.5), name="a")
        b = pm.Subdomain([1.0], [4.0], scheme=ALPHA(0.5, explicit=True), name="b")
        support = pm.Constraint({a: [[1.0, 0.0]]}, velocity=g)
        history = coupled(([a, b], [support, pm.tie(a, 1, b, 0)]), 2.0 / n).run(2.0)
        errors.append(largest(history["a"].u[-1] - exact[:2, -1]))
    assert np.log2(errors[0] / errors[1]) > 1.9


def test_the_work_of_the_shift_is_in_the_balance():
    """(B4) of a trapezoidal rule changes by - Y mu . M (w_n + w_{n+1}) / 2, and Y mu is what the
    displacements have beyond the trapezoidal rule. 1e-13: rounding of energies of order one."""
    (ours, ties), _ = random_loop(0.5, (1, 1, 1), (0, 0, 1), seed=2)
    ours = [
        pm.Subdomain(
            s.M,
            s.K,
            scheme=pm.CentralDifference() if i == 2 else pm.Newmark(),
            u0=s.u0,
            v0=s.v0,
            name=s.name,
        )
        for i, s in enumerate(ours)
    ]
    ties = [pm.tie(ours[0], 4, ours[1], 0), pm.tie(ours[1], 4, ours[2], 0)]
    dt = 0.1
    coupler = coupled((ours, ties), dt)
    history = coupler.run(steps=50, energy=True)
    x, M = history["0"], np.diag(ours[0].M) if ours[0].M.ndim == 1 else ours[0].M
    shift = np.diff(x.u, axis=0) - 0.5 * dt * (x.v[1:] + x.v[:-1])
    expected = -np.sum(shift @ M * 0.5 * (x.a[1:] + x.a[:-1]), axis=1)
    change = np.diff(history.energy.balance[:, 0])
    assert largest(change) > 1e-6  # there is something to compare
    assert largest(change - expected) < 1e-13
    assert largest(history.energy.interface.sum(axis=1)) < 1e-13


# ---- the state ---------------------------------------------------------------------------------


def test_pieces_files_and_threads_are_bitwise_the_same(tmp_path):
    def make(**options):
        ours, _ = random_loop(0.5, (1, 2, 4), (0, 0, 1))
        return coupled(ours, **options)

    whole = make().run(steps=30)
    coupler = make(threads=3)
    coupler.step(11)
    coupler.save(tmp_path / "state")
    snapshot = coupler.snapshot()
    pieces = [coupler.run(steps=19)]
    coupler.restore(snapshot)
    pieces.append(coupler.run(steps=19))
    other = make()
    other.load(tmp_path / "state")
    pieces.append(other.run(steps=19))
    coupler.reset()
    coupler.step(11)
    pieces.append(coupler.run(steps=19))
    for rest in pieces:
        for name in "012":
            for x in "uva":
                assert np.array_equal(getattr(rest[name], x)[-1], getattr(whole[name], x)[-1])
        assert np.array_equal(rest.multipliers[-1], whole.multipliers[-1])


def test_the_gap_belongs_to_the_state(tmp_path):
    """A gap of another start comes with the checkpoint, and a reset sets its own."""

    def make(u0):
        a = pm.Subdomain([1.0], [2.0], scheme=ALPHA(0.5), u0=[u0], name="a")
        b = pm.Subdomain([1.0], [9.0], scheme=ALPHA(0.5), substeps=3, name="b")
        return coupled(([a, b], pm.tie(a, 0, b, 0)), 0.1)

    with pytest.warns(pm.ConstraintWarning):
        first = make(0.25)
    first.step(5)
    first.save(tmp_path / "state")
    second = make(0.0)
    second.load(tmp_path / "state")
    assert largest(second.run(steps=5).displacement_jump - 0.25) < 1e-15
    with pytest.warns(pm.ConstraintWarning):
        second.reset(u0={"a": [0.5]})
    assert largest(second.run(steps=5).displacement_jump - 0.5) < 1e-15
    second.reset()
    assert largest(second.run(steps=5).displacement_jump) < 1e-15


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_the_gap_survives_a_change_of_steps_and_belongs_to_a_case():
    a = pm.Subdomain([1.0], [2.0], scheme=ALPHA(0.5), u0=[0.25], name="a")
    b = pm.Subdomain([1.0], [9.0], scheme=ALPHA(0.5), substeps=3, name="b")
    coupler = coupled(([a, b], pm.tie(a, 0, b, 0)), 0.1)
    cases = [{}, {"u0": {"a": [0.5]}}]
    jumps = [h.displacement_jump for h in coupler.run_each(cases, 2.0)]
    assert largest(jumps[0] - 0.25, jumps[1] - 0.5) < 1e-15
    coupler.step(5)
    coupler.change_steps(dt=0.05, substeps={"b": 4})
    assert largest(coupler.run(steps=20).displacement_jump - 0.25) < 1e-15


def test_a_checkpoint_of_kept_drift_is_another_problem(tmp_path):
    ours, _ = random_loop(0.5, (1, 2, 4), (0, 0, 0))
    coupled(ours, drift="kept").save(tmp_path / "state")
    with pytest.raises(ValueError, match="drift"):
        coupled(ours).load(tmp_path / "state")


# ---- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (dict(coupling="pm"), 'coupling="mean" has no drift'),
        (dict(coupling="macro"), 'coupling="mean" has no drift'),
        (dict(coupling="mean"), 'drift must be "kept" with coupling="mean", which ties'),
        (dict(coupling="gc", drift="both"), "drift must be"),
    ],
)
def test_other_couplings_and_words_are_refused(options, message):
    ours, _ = random_loop(0.5, (1, 1, 1), (0, 0, 0))
    with pytest.raises(ValueError, match=message):
        pm.Coupler(*ours, dt=0.1, **{"drift": "removed", **options})


@pytest.mark.parametrize("explicit", [False, True])
def test_internal_forces_are_refused(explicit):
    a = pm.Subdomain(
        [1.0],
        None,
        scheme=ALPHA(0.5, explicit=explicit),
        internal=lambda u, v, t, q: (u, np.eye(1)),
        name="a",
    )
    b = pm.Subdomain([1.0], [1.0], scheme=ALPHA(0.5), name="b")
    with pytest.raises(ValueError, match="internal forces in 'a'"):
        coupled(([a, b], pm.tie(a, 0, b, 0)))


def test_a_coupler_says_whether_its_drift_is_removed():
    ours, _ = random_loop(0.5, (1, 1, 1), (0, 0, 0))
    removed, kept = coupled(ours), coupled(ours, drift="kept")
    assert (removed.drift, kept.drift) == ("removed", "kept")
    assert "coupling = 'gc', drift removed, dt" in repr(removed)
    assert "drift" not in repr(kept)


def test_no_constraint_and_a_singular_matrix():
    a = pm.Subdomain([1.0], [1.0], scheme=ALPHA(0.5), v0=[1.0], name="a")
    history = coupled(([a], None)).run(steps=5)
    kept = coupled(([a], None), drift="kept").run(steps=5)
    assert np.array_equal(history["a"].u, kept["a"].u)
    for A in (np.zeros(1), np.zeros((2, 2)), sp.csr_array((2, 2))):
        with pytest.raises(pm.FactorizationError, match="S_mu"):
            tied.lu_factors(A, 1)


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
def test_central_difference_on_both_sides_of_a_tie_beside_other_schemes():
    # al1 = 0 in a and b: (V4) has a zero in their row beside the numbers of c
    schemes = dict(a=pm.CentralDifference(), b=pm.CentralDifference(), c=ALPHA(0.8, explicit=True))
    loads = dict(zip(schemes, (1.0, 2.0, 3.0)))
    made = [
        pm.Subdomain([1.0, 2.0], [3.0, 4.0], scheme=scheme, force=[loads[name], 0.0], name=name)
        for name, scheme in schemes.items()
    ]
    a, b, c = made
    for ties in ([pm.tie(a, 0, b, 0)], [pm.tie(a, 0, b, 0), pm.tie(b, 1, c, 1)]):
        history = coupled((made, ties)).run(2.0)
        assert largest(history.displacement_jump) < 1e-14 * largest(history["a"].u)  # rounding
        # the masses and springs of both sides as one, in dof 0
        pair = pm.Subdomain([2.0], [6.0], scheme=pm.CentralDifference(), force=[3.0])
        together = pm.solve(pair, 0.1, 2.0).u
        np.testing.assert_allclose(history["a"].u[:, :1], together, rtol=0.0, atol=1e-13)
