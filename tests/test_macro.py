"""Macro coupling: agreement with the reference, order, stability, energy and errors."""

import warnings
from functools import cache

import numpy as np
import pytest
import reference
import scipy.sparse as sp
import waits
from agreement import assert_run_agrees, assert_same_levels, largest
from pairwise import in_turn, pairwise
from reference_problems import Problem, random_problem, random_restored_problem, reference_subdomain
from scipy.integrate import solve_ivp

import pmalpha as pm
from pmalpha import analysis
from pmalpha.problem.matrices import dense
from pmalpha.setup import interface as macro

SECOND = pm.GeneralizedAlpha(0.5)
FAST = pm.GeneralizedAlpha(0.5, explicit=True)
STEPS = 9


@pytest.fixture
def repeated(thresholds):
    """No unit response is small enough to be stored."""
    thresholds(STORED=0)


# ---- against the reference --------------------------------------------------------------------


def random_macro_problem(seed, draw=random_problem):
    """A random problem with any numbers of substeps: none needs to divide another."""
    problem = draw(seed)
    rng = np.random.default_rng([seed, 6])
    for i, s in enumerate(problem.subdomains):
        s.substeps = int(rng.choice([1, 1, 2, 3, 5, 7]))
        s.double = bool(i > 0 and s.substeps == 1 and rng.random() < 0.5)
    return Problem(problem.subdomains, problem.L, problem.dt, problem.start, "macro")


def made(problem):
    """The coupler, without the warning of the undamped zig-zag of a double step at rho = 1."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        warnings.simplefilter("ignore", pm.ConstraintWarning)  # of ties without mass
        return problem.coupler()


# As in test_against_reference.py: rounding is magnified by the condition number of Mbar and H, up
# to 1e4 here, and by the number of steps.
AGREEMENT = 1e-9


def check_against_reference(seed, draw=random_problem):
    problem = random_macro_problem(seed, draw)
    history = made(problem).run(steps=STEPS)
    subdomains = [reference_subdomain(s, s.double) for s in problem.subdomains]
    expected = reference.run_macro(subdomains, problem.L, problem.dt, STEPS)
    inertia = largest(*(x.w @ s.M for x, s in zip(expected.subdomains, problem.subdomains)))
    assert_run_agrees(history, expected, AGREEMENT, force=inertia)


DRAWN = {"linear": random_problem, "restoring forces, lagged damping": random_restored_problem}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", DRAWN)
def test_core_and_reference_agree_on_a_random_problem_under_macro_coupling(kind, seed):
    check_against_reference(seed, DRAWN[kind])


@pytest.mark.parametrize(("seed", "kind"), in_turn(range(20, 30), *DRAWN))
def test_core_and_reference_agree_where_unit_responses_are_not_stored(seed, kind, repeated):
    check_against_reference(seed, DRAWN[kind])


def test_the_link_responses_of_the_restored_problems_meet_estimates_and_lagged_damping():
    # or the comparisons above would see less than they seem to
    seen = set()
    for seed in [*range(6), *range(21, 30, 2)]:
        problem = random_macro_problem(seed, random_restored_problem)
        for s, L in zip(problem.subdomains, problem.L):
            if s.substeps > 1 and L.any():
                seen |= {("lagged", s.lagged and s.C is not None)}
                seen |= {("K_r", s.K_r is not None), ("D_r", s.D_r is not None)}
    assert seen >= {("lagged", True), ("K_r", True), ("D_r", True)}


# ---- what must not change a run ---------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_unit_responses_of_several_threads_are_bitwise_those_of_one(coupling, thresholds):
    thresholds(RESPONSE_SHARE=1.0)  # entries: all threads have a share
    plate = pm.structures.plate(12, 6, 1.0, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    edge = plate.dofs(plate.nodes_at(x=12.0))
    other = ground(edge.size)

    def with_threads(threads):
        a = plate.subdomain(scheme=SECOND, substeps=4, name="plate")
        ties = pm.tie(a, edge, other, np.arange(edge.size))
        return pm.Coupler([a, other], ties, dt=0.2, coupling=coupling, threads=threads)

    def responses(coupler):
        part = coupler._session.members[0]
        rows = part.L.rows
        assert rows.size > macro.LANES  # more than one block
        return macro.unit_responses(part, rows, stored=True)

    one = responses(with_threads(1))
    for threads in (2, 9):
        for x, y in zip(responses(with_threads(threads)), one):
            np.testing.assert_array_equal(x, y)


def test_responses_of_several_threads_that_are_not_finite_are_refused(thresholds):
    thresholds(RESPONSE_SHARE=1.0)
    k, explicit = 40, pm.GeneralizedAlpha(0.5, explicit=True)
    wild = pm.Subdomain(np.ones(k), 1e300 * np.ones(k), scheme=explicit, substeps=9, name="wild")
    messages = set()
    for threads in (1, 2, 3):
        ties = pm.tie(wild, range(k), other := ground(k), range(k))
        with pytest.raises(ValueError, match="substeps of subdomain 'wild' must be more") as error:
            pm.Coupler([wild, other], ties, dt=1.0, coupling="macro", threads=threads)
        messages.add(str(error.value))
    assert len(messages) == 1


def test_small_unit_responses_are_stored_and_large_ones_are_not(repeated):
    a, b = halves(substeps=20)
    part = coupled(a, b)._session.members[1]
    assert not macro.is_stored(part)
    macro.STORED = 32 * part.n  # bytes of one constraint
    assert macro.is_stored(part)
    # a subdomain with more constraints than its substeps have entries to read
    many = pm.Subdomain(np.ones(50), np.ones(50), scheme=SECOND, substeps=2, name="many")
    ties = pm.tie(many, list(range(50)), other := ground(50), list(range(50)))
    many_tied = pm.Coupler([many, other], ties, dt=0.1, coupling="macro")
    macro.STORED = 10**9
    assert not macro.is_stored(many_tied._session.members[0])


def ground(n):
    return pm.Subdomain(np.ones(n), np.ones(n), scheme=SECOND, name="ground")


# ---- the split oscillator ---------------------------------------------------------------------

OMEGA = 2.0 * np.pi


def halves(b1=10.0, substeps=20, *, rho=0.5, double=None, v0=1.0):
    """Mass 1 and stiffness OMEGA^2 split in two, A implicit, B explicit; b1 = mA/mB = kB/kA."""
    mA, kA = b1 / (1.0 + b1), OMEGA**2 / (1.0 + b1)
    soft, fast = pm.GeneralizedAlpha(rho), pm.GeneralizedAlpha(rho, explicit=True)
    start = dict(u0=[1.0], v0=[v0])
    a = pm.Subdomain([mA], [kA], scheme=soft, double_step=double, name="A", **start)
    mB, kB = 1.0 - mA, OMEGA**2 - kA
    return a, pm.Subdomain([mB], [kB], scheme=fast, substeps=substeps, name="B", **start)


def coupled(a, b, dt=0.05, coupling="macro"):
    return pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling=coupling)


def orders(errors):
    errors = np.asarray(errors)
    return np.log2(errors[:-1] / errors[1:])


def errors_at_one(make, counts):
    """Errors of u, v, a and multipliers at t = 1, in macro steps of 1 / count."""
    rows = []
    for count in counts:
        coupler = make(1.0 / count)
        found = analysis.global_error(coupler, analysis.exact_solution(coupler), 1.0)
        rows.append([found[x] for x in ("u", "v", "a", "multipliers")])
    return rows


@pytest.mark.parametrize("substeps", [(1, 3, 7), (2, 3, 7)])
def test_three_subdomains_with_any_numbers_of_substeps_have_order_two(substeps):
    def make(dt):
        rng = np.random.default_rng(3)
        subdomains = []
        for ss, scheme, v0 in zip(substeps, (SECOND, FAST, SECOND), ([0.0, 0.0, 5.0], None, None)):
            A = rng.normal(size=(3, 3))
            K = 20.0 * A @ A.T + 10.0 * np.eye(3)
            M = np.diag(rng.uniform(1.0, 3.0, 3))
            subdomains.append(pm.Subdomain(M, K, C=0.01 * K, scheme=scheme, substeps=ss, v0=v0))
        a, b, c = subdomains
        ties = [pm.tie(a, [0, 1], b, [2, 0]), pm.tie(b, [1], c, [0])]
        return pm.Coupler(subdomains, ties, dt=dt, coupling="macro")

    # dt omega = 0.05 of the highest frequency at the coarser step: the next term
    assert orders(errors_at_one(make, [800, 1600]))[-1] == pytest.approx(2.0, abs=0.15)


def test_macro_coupling_with_one_substep_each_is_gc():
    runs = [coupled(*halves(substeps=1), 0.02, c).run(steps=200) for c in ("gc", "macro")]
    for one, other in zip(runs[0].subdomains, runs[1].subdomains):
        # the multipliers come by differences, which adds roundings: 2e-16 times 200 steps times 1/h
        assert largest(one.u - other.u) < 1e-11
    assert largest(runs[0].multipliers - runs[1].multipliers) < 1e-9


# ---- stability --------------------------------------------------------------------------------


@pytest.mark.gate
def test_the_spectral_radius_is_at_most_one():
    for case in pairwise(
        [0.0, 0.3, 0.5, 0.8, 0.95, 1.0],
        [0.01, 0.1, 1.0, 10.0, 100.0],
        [1, 2, 5, 20],
        [0.1, 0.6, 0.98],
        [None, True],
    ):
        rho, b1, substeps, share, double = case
        explicit = pm.GeneralizedAlpha(rho, explicit=True)
        limit = analysis.critical_step(pm.Subdomain([1.0], [1.0], scheme=explicit))
        omega_b = np.sqrt(b1) * OMEGA  # frequency of B by itself
        dt = share * limit / omega_b * substeps
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)  # the zig-zag at rho = 1
            coupler = coupled(*halves(b1, substeps, rho=rho, double=double), dt)
        radius = analysis.spectral_radius(analysis.amplification_matrix(coupler))
        # a defective eigenvalue 1 comes out within the root of the rounding
        assert radius <= 1.0 + 1e-7, f"radius {radius} at {case}"


@pytest.mark.gate
def test_random_systems_of_three_subdomains_in_a_loop_are_stable():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        subdomains = []
        for ss in rng.integers(1, 8, 3):
            A = rng.normal(size=(2, 2))
            K = 10.0 * A @ A.T
            rho = float(rng.uniform(0.0, 0.99))
            M, scheme = np.diag(rng.uniform(0.5, 2.0, 2)), pm.GeneralizedAlpha(rho)
            subdomains.append(pm.Subdomain(M, K, scheme=scheme, substeps=int(ss)))
        a, b, c = subdomains
        ties = [pm.tie(a, [1], b, [0]), pm.tie(b, [1], c, [0]), pm.tie(c, [1], a, [0])]
        dt = float(rng.uniform(0.05, 3.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = pm.Coupler(subdomains, ties, dt=dt, coupling="macro")
        radius = analysis.spectral_radius(analysis.amplification_matrix(coupler))
        assert radius <= 1.0 + 1e-6, seed


# ---- loads ------------------------------------------------------------------------------------


def test_loads_are_evaluated_once_per_time_level_in_the_order_of_time():
    times = []

    def force(t):
        times.append(t)
        return np.zeros(1)

    a, b = halves(substeps=3)
    b = pm.Subdomain(b.M, b.K, scheme=b.scheme, substeps=3, force=force, u0=[1.0], v0=[1.0])
    c = pm.Subdomain([1.0], [1.0], scheme=SECOND, substeps=7, u0=[1.0], v0=[1.0])
    ties = [pm.tie(a, [0], b, [0]), pm.tie(b, [0], c, [0])]
    coupler = pm.Coupler([a, b, c], ties, dt=0.1, coupling="macro")
    history = coupler.run(steps=5)
    assert times == [k / 3 * 0.1 for k in range(16)]
    np.testing.assert_array_equal(history[1].t, times)
    # equal instants are bitwise identical
    np.testing.assert_array_equal(history[1].t[::3], history[2].t[::7])


def test_prescribed_motion_is_followed_at_the_ends_of_macro_steps():
    def g(t):
        return np.array([np.sin(t) ** 2])

    a, b = halves(substeps=7, v0=0.0)
    a, b = (pm.Subdomain(s.M, s.K, scheme=s.scheme, substeps=s.substeps) for s in (a, b))
    constraints = [pm.tie(a, [0], b, [0]), pm.Constraint({b: [[1.0]]}, velocity=g)]
    coupler = pm.Coupler([a, b], constraints, dt=0.02, coupling="macro")
    history = coupler.run(2.0)
    expected = np.sin(history[0].t) ** 2
    assert largest(history[0].v[:, 0] - expected) < 1e-13
    assert largest(history[1].v[::7, 0] - expected) < 1e-13
    # u = t/2 - sin(2t)/4, to order 2: dt^2 is 4e-4
    exact = history[0].t / 2 - np.sin(2 * history[0].t) / 4
    assert largest(history[0].u[:, 0] - exact) < 1e-4
    assert largest(history[1].u[::7, 0] - exact) < 1e-4


# ---- all or nothing ---------------------------------------------------------------------------


def test_a_load_that_raises_leaves_the_last_whole_macro_step():
    def force(t):
        if t > 0.33:
            raise RuntimeError("enough")
        return np.zeros(1)

    broken, whole = (coupled(*halves(substeps=4), 0.1) for _ in range(2))
    broken.reset(force={"B": force})
    with pytest.raises(RuntimeError, match="enough"):
        broken.run(steps=10)
    whole.step(3)
    assert broken.step_count == 3
    assert broken.last_history.macro_times[-1] == 3 * 0.1
    assert_same_levels(broken, whole)


def test_a_run_that_grows_stops_at_the_last_whole_macro_step_and_names_the_subdomain():
    with pytest.warns(pm.StabilityWarning):
        coupler, other = (coupled(*halves(10.0, 5), 1.0) for _ in range(2))
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.run(steps=100_000)
    other.step(coupler.step_count)
    assert caught.value.step == coupler.step_count
    assert caught.value.subdomain in ("A", "B")
    assert_same_levels(coupler, other)


@pytest.mark.parametrize("storing", ["stored", "repeated"])
@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_substeps_are_bitwise_the_same_whether_recorded_and_observed_or_not(
    coupling, storing, thresholds
):
    if storing == "repeated":
        thresholds(STORED=0)
    bar = pm.structures.solid(6, 2, 2, 1.0, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    load, held = np.sin(np.arange(bar.n)), bar.K + 0.01 * sp.eye_array(bar.n)
    long = pm.Subdomain(bar.M, held, scheme=FAST, substeps=9, force=load, name="bar")
    mass = pm.Subdomain(np.ones(2), np.ones(2), scheme=SECOND, name="mass")
    tie = pm.tie(long, bar.dofs(bar.nodes_at(x=6.0))[:2], mass, [0, 1])
    plain, recorded, observed = (
        pm.Coupler([long, mass], tie, dt=0.9, coupling=coupling, threads=1) for _ in range(3)
    )
    plain.step(4)
    recorded.run(steps=4)
    observed.run(steps=4, energy=True)
    assert_same_levels(plain, recorded)
    assert_same_levels(plain, observed)


# ---- H, and the messages of set-up ------------------------------------------------------------


def blocky(n, seed):
    """A positive definite matrix with blocks of three dofs, which is stored in strips."""
    rng = np.random.default_rng(seed)
    A = sp.kron(sp.random_array((n // 3, n // 3), density=0.1, rng=rng), rng.normal(size=(3, 3)))
    return (A @ A.T + sp.eye_array(n)).tocsr()


FORMS = {
    "dense": lambda: blocky(60, 1).toarray(),
    "strips": lambda: blocky(60, 1),
    "band": lambda: sp.diags_array([-1.0, 3.0, -1.0], offsets=[-1, 0, 1], shape=(60, 60)).tocsr(),
}


def mean_responses(step, L, substeps):
    """u, v, w, a (n, p) after the substeps of (K3), by the matrices of a step of the reference."""
    s, h = step.subdomain, step.h
    y = np.linalg.solve(s.M, L.T)
    u, v, w, a = (np.zeros_like(y) for _ in range(4))
    for _ in range(substeps):
        ratio = s.af / (1.0 - s.am)
        ut = u + h * v + h**2 * ((0.5 - s.beta / (1.0 - s.am)) * a + s.beta * ratio * w + 0.5 * y)
        vt = v + h * ((1.0 - s.gamma / (1.0 - s.am)) * a + s.gamma * ratio * w + y)
        w1 = -np.linalg.solve(step.mbar, s.C @ vt + s.K @ ut)
        a = ((1.0 - s.af) * w1 + s.af * w - s.am * a) / (1.0 - s.am)
        u, v, w = ut + step.al1 * w1, vt + step.al2 * w1, w1
    return {"u": u, "v": v, "w": w, "a": a}


@pytest.mark.parametrize("explicit", [False, True])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_unit_responses_of_many_constraints_are_those_of_the_reference(form, explicit, coupling):
    K, M = FORMS[form](), np.linspace(1.0, 2.0, 60)
    count = 19  # two full blocks of eight and three more
    scheme = pm.GeneralizedAlpha(0.8, explicit=explicit)
    C = np.linspace(0.3, 0.1, 60)  # not proportional
    part = pm.Subdomain(M, K, C=C, scheme=scheme, substeps=3, name="part")
    other = pm.Subdomain(np.ones(count), np.ones(count), scheme=SECOND)
    dofs = list(range(2, 2 + 3 * count, 3))
    tie = pm.tie(part, dofs, other, list(range(count)))
    made = pm.Coupler([part, other], tie, dt=0.3, coupling=coupling)._session.members[0]
    L = np.zeros((count, 60))
    L[np.arange(count), dofs] = 1.0
    alpha = dict(am=scheme.am, af=scheme.af, beta=scheme.beta, gamma=scheme.gamma)
    M, K = np.diag(M), dense(K)
    subdomain = reference.Subdomain(M, K, C=np.diag(C), **alpha, explicit=explicit, substeps=3)
    if coupling == "macro":
        U = reference.MacroStepper(subdomain, L, 0.3).U[-1]
    else:
        U = mean_responses(reference.Step(subdomain, L, 0.1), L, 3)
    end, mean = np.empty((count, count)), np.empty((count, count))
    states = np.empty((count, 4, 60))
    assert made.core.unit_responses(np.arange(count), end, mean, states)
    for field, name in enumerate("uvwa"):
        found = np.empty((60, count))
        found[made.order] = states[:, field].T
        # rounding of three steps of matrices of condition 100
        assert largest(found - U[name]) < 1e-12 * largest(U[name])
    tied = "v" if coupling == "macro" else "u"
    assert largest(end.T - L @ U[tied]) < 1e-12 * largest(end)
    if coupling == "macro":
        for H in (end, mean):  # one per cent of C left out of one side would show at 1e-3
            assert largest(H - H.T) < 1e-13 * largest(H) and np.linalg.eigvalsh(H).min() > 0.0


def test_ctrl_c_ends_the_unit_responses_between_two_substeps():
    n = 400
    slow = pm.Subdomain(np.ones(n), np.eye(n) + 0.001, scheme=FAST, substeps=1_000_000, name="slow")
    other = pm.Subdomain(np.ones(1), np.ones(1), scheme=SECOND)

    # the warning comes shortly before them
    with pytest.warns(pm.PerformanceWarning) as warned, pytest.raises(KeyboardInterrupt):
        with waits.ctrl_c_when(lambda: len(warned), after=0.1):
            pm.Coupler([slow, other], pm.tie(slow, [0], other, [0]), dt=1.0, coupling="macro")


def resonant(detuning):
    """Two subdomains with the macro step as their period."""
    omega = OMEGA * (1.0 + detuning)
    scheme = pm.GeneralizedAlpha(1.0)
    a, b = (
        pm.Subdomain([m], [m * omega**2], scheme=scheme, substeps=20, name=f"part {m}")
        for m in (1, 2)
    )
    return coupled(a, b, 1.0)


def test_subdomains_that_resonate_with_the_macro_step_are_named():
    # trapezoidal rule, 20 substeps: the period is 0.8 % longer than that of the equation
    text = "'part 1' and 'part 2' resonate with.*constraint 0.*change dt"
    with pytest.warns(pm.StabilityWarning, match=text):
        resonant(0.008)
    resonant(0.4)  # no warning between two resonances


def test_a_restoring_force_with_substeps_is_warned_of_and_one_without_is_not():
    def rig(substeps):
        return pm.Subdomain(
            [1.0], None, scheme=SECOND, substeps=substeps, restoring=lambda t, u, v: u, name="rig"
        )

    a, _ = halves(v0=0.0)
    a = pm.Subdomain(a.M, a.K, scheme=SECOND)
    with pytest.warns(pm.StabilityWarning, match="restoring forces of subdomain 'rig'"):
        coupled(a, rig(2))
    coupled(a, rig(1))


def test_double_steps_with_substeps_or_in_all_subdomains_are_refused():
    a, b = halves(substeps=2)
    twice = pm.Subdomain(b.M, b.K, scheme=b.scheme, substeps=2, double_step=True, name="twice")
    with pytest.raises(ValueError, match="double_step .* 'twice'"):
        pm.Coupler([a, twice], dt=0.1, coupling="macro")
    a, b = (pm.Subdomain([1.0], [1.0], scheme=SECOND, double_step=True, name=name) for name in "ab")
    with pytest.raises(ValueError, match="double_step must not be True on all"):
        coupled(a, b)


def test_no_subdomain_takes_double_steps_by_default():
    a, b = halves(substeps=4)
    assert not any(part.double for part in coupled(a, b)._session.members)
    assert [part.double for part in coupled(a, b, coupling="pm")._session.members] == [True, False]


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_unit_responses_that_take_long_are_warned_of_or_refused(thresholds, coupling):
    a, b = halves(substeps=20)
    thresholds(LONG=0.0)
    text = f"coupling=\"{coupling}\" needs .* 'B': 1 constraint times 20 substeps"
    with pytest.warns(pm.PerformanceWarning, match=text):
        coupled(a, b, coupling=coupling)
    thresholds(ABSURD=0.0)
    with pytest.raises(ValueError, match='take coupling="pm" or "gc"'):
        coupled(a, b, coupling=coupling)


def test_unit_responses_that_do_not_fit_are_refused_with_the_figures(monkeypatch, thresholds):
    monkeypatch.setattr("pmalpha.memory.available", lambda: 1000)
    thresholds(ALLOCATION=0)
    a, b = (pm.Subdomain(np.ones(9), np.ones(9), scheme=SECOND, substeps=2, name=n) for n in "ab")
    with pytest.raises(MemoryError, match="link response of 'a' to 9 constraints needs about"):
        pm.Coupler([a, b], pm.tie(a, list(range(9)), b, list(range(9))), dt=0.1, coupling="macro")


def test_the_amplification_matrix_contains_the_multipliers():
    coupler = coupled(*halves(substeps=3, double=True))
    G = analysis.amplification_matrix(coupler)
    assert G.names[0] == "u[0] of A at n-1" and G.names[4] == "u[0] of A at n"
    assert G.names[8] == "u[0] of B at n" and G.names[-1] == "Lam[0]"
    assert G.shape == (13, 13)
    # compared with two macro steps after the start
    coupler.step(1)
    X = state_of(coupler)
    coupler.step(1)
    expected = state_of(coupler)
    # one macro step of some ten roundings each, of numbers up to omega^2
    assert largest(G @ X - expected) < 1e-11


def state_of(coupler):
    """X of the amplification matrix, whose first subdomain takes double steps."""
    a, b = (part.core.levels() for part in coupler._session.members)
    names = [*(f"previous_{x}" for x in "uvwa"), *"uvwa"]
    return np.concatenate([*(a[x] for x in names), *(b[x] for x in "uvwa"), coupler.multipliers])


def test_subdomains_and_couplers_without_constraints_run_as_alone():
    a, b = halves(substeps=3)
    alone = pm.Subdomain([1.0], [4.0], scheme=SECOND, substeps=5, u0=[1.0], name="alone")
    history = pm.Coupler([a, b, alone], pm.tie(a, [0], b, [0]), dt=0.1, coupling="macro").run(
        steps=10
    )
    by_itself = pm.solve(alone, dt=0.1, t_end=1.0)
    np.testing.assert_array_equal(history["alone"].u, by_itself.u)
    uncoupled = pm.Coupler([alone], dt=0.1, coupling="macro").run(steps=10)
    np.testing.assert_array_equal(uncoupled["alone"].u, by_itself.u)


# ---- energy -----------------------------------------------------------------------------------


def works_of(problem, history, i):
    """Dissipated, external and interface work of a subdomain, from all time levels and (M1)."""
    s, L, x = problem.subdomains[i], problem.L[i], history[i]
    levels = np.arange(len(x.t)) / s.substeps
    at_macro_steps = np.arange(len(history.multipliers))
    lam = np.array(
        [np.interp(levels, at_macro_steps, column) for column in history.multipliers.T]
    ).T
    force = s.reference_force or (lambda t: np.zeros(len(s.M)))
    C = np.zeros_like(s.M) if s.C is None else s.C
    forces = [x.v @ C, np.array([force(t) for t in x.t]), lam @ L]
    works = np.zeros((len(x.t), 3))
    for level in range(1, len(x.t)):
        origin = level - 2 if s.double and level > 1 else level - 1
        du = x.u[level] - x.u[origin]
        works[level] = works[origin] + [du @ (q[origin] + q[level]) / 2.0 for q in forces]
    return works[:: s.substeps]


@pytest.mark.parametrize("seed", range(8))
def test_the_energies_follow_from_the_recorded_states_and_change_no_result(seed):
    problem = random_macro_problem(seed)
    for s in problem.subdomains:
        s.restoring = s.K_r = s.D_r = None  # their force at a time level is not recorded
    summed, plain = made(problem), made(problem)
    history = summed.run(steps=9, energy=True)
    plain.step(9)
    assert_same_levels(summed, plain)
    energy = history.energy
    size = max(energy.kinetic.max(), energy.strain.max())
    for i, s in enumerate(problem.subdomains):
        x = history[i]
        kinetic = 0.5 * np.einsum("ki,ij,kj->k", x.v, s.M, x.v)[:: s.substeps]
        # sums of some 100 products in another order: 1e-13 of the largest
        assert largest(energy.kinetic[:, i] - kinetic) < 1e-11 * size
        got = [energy.dissipated[:, i], energy.external[:, i], energy.interface[:, i]]
        assert largest(np.transpose(got) - works_of(problem, history, i)) < 1e-11 * size


# ---- restoring forces -------------------------------------------------------------------------


def duffing(t, u, v):
    return 30.0 * u + 60.0 * u**3


def van_der_pol(t, u, v):
    return 20.0 * u + 6.0 * (u**2 - 0.25) * v


def nonlinear_error(r, K_r, D_r, substeps, explicit, dt):
    """Largest errors of u and v over 0.5 s of a mass tied to one on a restoring force."""
    a = pm.Subdomain([0.6], [10.0], scheme=SECOND, u0=[1.0], name="a")
    how = dict(scheme=FAST if explicit else SECOND, substeps=substeps, restoring=r, u0=[1.0])
    how |= dict(restoring_stiffness=None if K_r == 0.0 else [K_r])
    how |= dict(restoring_damping=None if D_r == 0.0 else [D_r])
    b = pm.Subdomain([0.4], None, name="b", **how)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        s = coupled(a, b, dt).run(0.5)["a"]
    truth = uncut(r)(s.t)
    return np.array([largest(s.u[:, 0] - truth[0]), largest(s.v[:, 0] - truth[1])])


@cache
def uncut(r):
    """u and v of the oscillator of mass 1, far below every error here, 1e-5 and more."""
    return solve_ivp(
        lambda t, x: [x[1], -10.0 * x[0] - r(t, x[0], x[1])],
        (0.0, 0.51), [1.0, 0.0], method="DOP853", dense_output=True, rtol=1e-11, atol=1e-12,
    ).sol  # fmt: skip


@pytest.mark.parametrize(
    ("force", "share", "substeps", "explicit"),
    pairwise([duffing, van_der_pol], [0.0, 1.0, 2.0], [1, 2, 5], [True, False]),
)
def test_restoring_forces_keep_order_two_under_macro_coupling(force, share, substeps, explicit):
    K_r, D_r = (30.0, 0.0) if force is duffing else (20.0, 3.0)
    errors = [
        nonlinear_error(force, share * K_r, share * D_r, substeps, explicit, dt)
        for dt in (1 / 200, 1 / 400)
    ]
    # dt omega = 0.06 at the coarser step, and of the Duffing subdomain three times as much
    assert orders(errors)[0] == pytest.approx(2.0, abs=0.25)


def growth(share, product, substeps=10, coupling="macro"):
    """Growth in a run of 100 macro steps: largest value of its end over that of its beginning.

    Two masses, the spring of the second as a restoring force, omega dt = product for both.
    """
    k = 0.5 * product**2
    a = pm.Subdomain([0.5], [k], scheme=SECOND, u0=[1.0])
    how = dict(restoring=lambda t, u, v: k * u, substeps=substeps, u0=[1.0])
    how |= dict(restoring_stiffness=None if share == 0.0 else [share * k])
    b = pm.Subdomain([0.5], None, scheme=FAST, **how)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.StabilityWarning)
        try:
            x = coupled(a, b, 1.0, coupling).run(steps=100, every=1)[1]
        except pm.InstabilityError:
            return np.inf
    size = np.abs(x.u[:, 0]) + np.abs(x.v[:, 0]) / product
    return size[-20:].max() / size[:50].max()


@pytest.mark.filterwarnings("ignore:tied displacements")  # in growing motions they part
def test_a_stiff_restoring_force_with_substeps_needs_its_stiffness_estimated():
    # measured: 28 to 1e34 at omega dt = 4, and 0.3 to 0.5 with the correct estimate
    for share in (0.0, 0.5, 2.0):
        assert growth(share, 4.0) > 10.0, share
    for share, product in ((1.0, 0.5), (0.9, 4.0), (1.0, 8.0)):
        assert growth(share, product) < 1.0, product
    for coupling in ("pm", "gc"):
        assert growth(0.0, 4.0, coupling=coupling) < 1.0, coupling


def test_commands_to_a_rig_differ_from_the_final_displacements():
    def off(coupling, count):
        commands = []

        def rig(t, u, v):
            commands.append(float(u[0]))
            return 0.0 * u

        a, b = halves(10.0, 10, v0=0.0)
        b = pm.Subdomain(b.M, b.K, scheme=b.scheme, substeps=10, restoring=rig, u0=[1.0], name="B")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = coupled(a, b, 1.0 / count, coupling)
        final = coupler.run(1.0)["B"].u[1:, 0]
        return largest(np.array(commands[1:]) - final)  # the first is that of t = 0

    # the predictor of a final step is off by al1 w, here 7e-5; the free macro run by 6e-3, O(dt^2)
    assert off("pm", 40) < 1e-4 and off("gc", 40) < 1e-4
    assert 4e-3 < off("macro", 40) < 8e-3
    assert off("macro", 80) < off("macro", 40) / 4.0


def test_a_tie_without_mass_costs_an_order_and_is_warned_of():
    K = np.array([[30.0, -30.0], [-30.0, 45.0]])

    def error(dt, coupling, substeps):
        a = pm.Subdomain([1.0], [20.0], scheme=SECOND, name="a")
        b = pm.Subdomain([0.0, 1.0], K, scheme=SECOND, substeps=substeps, v0=[0.0, 1.0], name="b")
        s = coupled(a, b, dt, coupling).run(1.0, every=1)["a"]
        exact = reference.exact(
            np.eye(2), None, K + np.diag([20.0, 0.0]), np.zeros(2), np.array([0.0, 1.0]), s.t
        )
        return largest(s.u[:, 0] - exact[0][:, 0])

    steps = (1 / 200, 1 / 400)
    with pytest.warns(pm.ConstraintWarning, match="interface dofs without mass: dof 0 of 'b';"):
        first = [error(dt, "macro", 2) for dt in steps]
    assert orders(first)[0] == pytest.approx(1.0, abs=0.1)
    for coupling, substeps in (("macro", 1), ("gc", 2), ("pm", 2)):
        second = [error(dt, coupling, substeps) for dt in steps]
        assert orders(second)[0] == pytest.approx(2.0, abs=0.1)
