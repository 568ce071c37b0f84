"""Mean coupling: exact energy, no drift, order 2; section 15 of docs/method.md."""

import numpy as np
import pytest
from agreement import assert_close, assert_constant, assert_order, assert_small, largest
from pairwise import in_turn, pairwise
from scipy.linalg import expm

import pmalpha as pm

TRAPEZOIDAL = [pm.Newmark()] * 3
MIXED = [pm.Newmark(), pm.Newmark(), pm.CentralDifference()]
DAMPED = [pm.GeneralizedAlpha(0.5)] * 3


def loop(substeps, schemes, dt, *, double=False, sparse=False, coupling="mean", **options):
    """Three random subdomains of four dofs in a loop of ties, none with initial motion at a tie."""
    rng = np.random.default_rng(3)
    subdomains = []
    for i, (s, scheme) in enumerate(zip(substeps, schemes)):
        A = rng.normal(size=(4, 4))
        K, M = 3.0 * A @ A.T + np.eye(4), rng.uniform(0.5, 2.0, 4)
        u0, v0 = 0.1 * rng.normal(size=4), rng.normal(size=4)
        u0[[0, 3]] = v0[[0, 3]] = 0.0
        M = np.diag(M) + 0.1 * np.ones((4, 4)) if sparse else M
        how = dict(double_step=(double and i == 0) or None, u0=u0, v0=v0, name=str(i))
        subdomains.append(pm.Subdomain(M, K, scheme=scheme, substeps=s, **how))
    a, b, c = subdomains
    ties = [pm.tie(a, 3, b, 0), pm.tie(b, 3, c, 0), pm.tie(c, 3, a, 0)]
    return pm.Coupler(subdomains, ties, dt=dt, coupling=coupling, **options)


def exact(coupler, t):
    """u, v and acceleration of the uncut structure, by subdomain."""
    M, _, K, dofs = coupler.assembled()
    M, K = M.toarray(), K.toarray()
    whole = np.vstack([dofs[s.name].toarray() for s in coupler.subdomains])
    start = [
        np.linalg.lstsq(whole, np.concatenate(x), rcond=None)[0]
        for x in ([s.u0 for s in coupler.subdomains], [s.v0 for s in coupler.subdomains])
    ]
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]])
    state = expm(A * t) @ np.concatenate(start)
    u, v = state[:n], state[n:]
    return {
        s.name: [dofs[s.name] @ x for x in (u, v, -np.linalg.solve(M, K @ u))]
        for s in coupler.subdomains
    }


@pytest.mark.parametrize(
    ("substeps", "sparse"), in_turn([(1, 1, 1), (1, 3, 7), (2, 3, 7), (1, 1, 1)], False, True, True)
)
def test_energy_is_exact(substeps, sparse):
    """1e-12: the rounding of a thousand macro steps."""
    history = loop(substeps, TRAPEZOIDAL, 0.05, sparse=sparse).run(steps=1000, energy=True)
    total = (history.energy.kinetic + history.energy.strain).sum(axis=1)
    at = {"times": history.energy.t}
    assert_constant(total, 1e-12, "energy", **at)
    for name in ("balance", "interface"):
        work = getattr(history.energy, name).sum(axis=1)
        assert_small(work, 1e-12, f"{name} of all subdomains", size=total[0], **at)


@pytest.mark.parametrize("schemes", [TRAPEZOIDAL, MIXED, DAMPED])
@pytest.mark.parametrize("double", [False, True])
def test_nothing_drifts(schemes, double):
    substeps = (1, 1, 1) if double else (1, 3, 7)
    for steps in (3, 1000):  # the first few name what is wrong before it grows
        history = loop(substeps, schemes, 0.05, double=double).run(steps=steps)
        at = {"times": history.macro_times, "column": "constraint"}
        size = largest(*(s.u for s in history.subdomains))
        assert_small(history.displacement_jump, 1e-14, "displacement jump", size=size, **at)


@pytest.mark.parametrize(
    ("schemes", "substeps", "double"),
    [
        (TRAPEZOIDAL, (1, 1, 1), False),
        (TRAPEZOIDAL, (2, 3, 20), False),
        *((schemes, (1, 3, 7), False) for schemes in (MIXED, DAMPED)),
        *((schemes, (1, 1, 1), True) for schemes in (MIXED, DAMPED)),
    ],
)
def test_displacements_and_velocities_are_of_order_two(schemes, substeps, double):
    reference = exact(loop(substeps, schemes, 0.05), 1.0)
    errors = []
    for n in (80, 160):
        history = loop(substeps, schemes, 1.0 / n, double=double).run(1.0)
        errors.append(
            [
                max(np.max(np.abs(getattr(history[k], q)[-1] - x[i])) for k, x in reference.items())
                for i, q in enumerate("uva")
            ]
        )
    orders = np.log2(np.divide(*errors))
    least = {"displacements": 1.9, "velocities": 1.9, "accelerations, (K5)": 1.7}
    for name, order in zip(least, orders[: 2 if double else 3]):
        assert order > least[name], f"the {name} are of order {order:.2f}, not {least[name]}"


def test_means_of_neighbouring_multipliers_are_of_order_two():
    errors = []
    for n in (80, 160):
        coupler = loop((1, 3, 7), TRAPEZOIDAL, 1.0 / n)
        history = coupler.run(1.0)
        assert history.multiplier_times[-1] == pytest.approx(1.0 - 0.5 / n)
        solution = exact(coupler, 1.0 - 1.0 / n)
        forces = np.concatenate(
            [s.M * solution[s.name][2] + s.K @ solution[s.name][0] for s in coupler.subdomains]
        )
        L = np.vstack([A.toarray().T for A in coupler._session.rows.matrices])
        lam = np.linalg.lstsq(L, forces, rcond=None)[0]
        errors.append(np.max(np.abs(history.multipliers[-2:].mean(axis=0) - lam)))
    assert np.log2(errors[0] / errors[1]) > 1.8


def tied_springs(explicit, C=0.0, u0=(0.0, 0.0)):
    """Two springs to the ground under loads, whose masses are tied; omega h = 0.2 in the second."""
    a = pm.Subdomain([2.0], [3.0], C=[C], scheme=pm.Newmark(), force=[5.0], u0=u0[:1], name="a")
    b = pm.Subdomain(
        [1.0], [16.0], C=[C], scheme=explicit, substeps=2, force=[-1.0], u0=u0[1:], name="b"
    )
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="mean")


def test_the_static_solution_is_at_rest_with_central_difference():
    u = tied_springs(pm.CentralDifference()).static()
    coupler = tied_springs(pm.CentralDifference(), u0=(u["a"][0], u["b"][0]))
    history = coupler.run(steps=300)
    for name in "ab":  # rounding, which 600 substeps add up
        assert np.max(np.abs(history[name].u - u[name])) < 1e-13
        assert np.max(np.abs(history[name].v)) < 1e-12


@pytest.mark.parametrize("rho", [0.5, 1.0])
def test_explicit_generalized_alpha_rests_beside_it(rho):
    # (K9): 3 u = 5 + lam and 16 (u + al1 y) = -1 - lam with y = -lam
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    beta = 0.25 * (1.0 - am + af) ** 2
    al1 = 0.05**2 * beta * (1.0 - af) / (1.0 - am)
    u, lam = np.linalg.solve([[3.0, -1.0], [16.0, 1.0 - 16.0 * al1]], [5.0, -1.0])
    coupler = tied_springs(pm.GeneralizedAlpha(rho, explicit=True), C=2.0)
    coupler.step(1000)  # damped: exp(-c t / 2 m) = e-67
    static = coupler.static()
    assert coupler.state("a").u[0] == pytest.approx(u, abs=1e-13)
    assert coupler.state("b").u[0] == pytest.approx(u, abs=1e-13)
    assert coupler.multipliers[0] == pytest.approx(lam, abs=1e-12)
    assert abs(u - static["a"][0]) > 1e-3 * abs(u)


def test_recorded_accelerations_are_those_of_the_present():
    coupler = loop((1, 3, 7), MIXED, 0.05)
    first = coupler.run(steps=7)
    second = coupler.run(steps=5)
    for name in "012":
        assert np.array_equal(first[name].a[-1], second[name].a[0])
        assert np.array_equal(second[name].a[-1], coupler.state(name).a)


def test_stored_and_repeated_responses_agree(monkeypatch):
    """1e-12: two orders of the same sums."""
    stored = loop((1, 3, 7), DAMPED, 0.05).run(steps=50)
    monkeypatch.setattr("pmalpha.setup.interface.is_stored", lambda part: False)
    repeated = loop((1, 3, 7), DAMPED, 0.05).run(steps=50)
    for name in "012":
        for x in "uva":
            one, two = getattr(stored[name], x), getattr(repeated[name], x)
            assert_close(two, one, 1e-12, f"{x} of {name!r}", size=largest(one))


@pytest.mark.parametrize(
    ("how", "consistent", "double"),
    pairwise(
        [(pm.Newmark(), 0.0), (pm.Newmark(), 0.1), (pm.GeneralizedAlpha(0.5), 0.0)],
        [False, True],
        [False, True],
    ),
)
def test_a_single_step_is_closed_as_it_would_respond(monkeypatch, how, consistent, double):
    """(K7) against (K3), with loads and energies; 1e-12: two orders of the same sums."""
    scheme, damping = how
    K = np.diag([4.0, 3.0, 2.0]) - np.eye(3, k=1) - np.eye(3, k=-1)
    M = np.diag([2.0, 1.0, 3.0]) + 0.3 * consistent * (np.eye(3, k=1) + np.eye(3, k=-1))
    C = damping * np.diag([3.0, 1.0, 2.0]) if damping else None

    def histories(deferred):
        a, b = (
            pm.Subdomain(
                M if consistent else np.diag(M), stiffness * K, C=C, scheme=scheme, name=name,
                force=lambda t: np.array([np.sin(t), 0.0, 1.0]),
                double_step=(double and name == "a") or None,
            )
            for name, stiffness in (("a", 1.0), ("b", 3.0))
        )  # fmt: skip
        coupler = pm.Coupler([a, b], pm.tie(a, [0, 2], b, [2, 0]), dt=0.3, coupling="mean")
        assert {part.deferred for part in coupler._session.members} == {deferred}
        return coupler.run(steps=40, energy=True)

    closed = histories(True)
    monkeypatch.setattr("pmalpha.setup.member.Member.deferred", property(lambda part: False))
    responded = histories(False)
    for name in "ab":
        for x in "uva":
            one, two = getattr(closed[name], x), getattr(responded[name], x)
            assert_close(one, two, 1e-12, f"{x} of {name!r}", size=largest(two))
    one, two = closed.energy.interface, responded.energy.interface
    what, named = "work at the interface", {"size": largest(two), "column": "subdomain"}
    assert_close(one, two, 1e-12, what, **named)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # grows, as meant below
def test_damping_is_of_no_account_to_a_step_that_is_deferred_for_the_trapezoidal_rule():
    changes = [{}, dict(scheme=pm.GeneralizedAlpha(0.5)), dict(damping="lagged")]
    changes += [dict(substeps=2), dict(scheme=pm.CentralDifference())]
    for change in changes:
        values = dict(C=[0.1, 0.2], scheme=pm.Newmark(), name="a") | change
        a = pm.Subdomain([1.0, 1.0], [1.0, 1.0], **values)
        b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b")
        coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="mean")
        assert coupler._session.members[0].deferred is (not change), change


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.5), pm.HHT(0.2), pm.CentralDifference()])
@pytest.mark.parametrize(("substeps", "double"), [(1, None), (3, None), (1, True)])
def test_nothing_drifts_with_damping_that_is_not_proportional(scheme, substeps, double):
    """H is not symmetric then, (K8): half of it left gaps of 1e-6."""
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]])
    values = dict(scheme=scheme, substeps=substeps, double_step=double, v0=[0.0, 0.0, 1.0])
    a = pm.Subdomain([1.0, 2.0, 3.0], K, C=[0.4, 0.0, 0.1], name="a", **values)
    b = pm.Subdomain([1.0, 1.0], [1.0, 2.0], scheme=pm.Newmark(), name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [0, 1], b, [0, 1]), dt=0.5, coupling="mean")
    history = coupler.run(10.0)
    assert np.abs(history.displacement_jump).max() < 1e-14  # rounding; the motion is about 1


def damped(scheme, c=0.1, substeps=1, **values):
    a = pm.Subdomain([1.0], [1.0], C=[c], scheme=scheme, substeps=substeps, name="a", **values)
    b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b")
    return pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.5, coupling="mean")


GROWING = [pm.GeneralizedAlpha(0.0), pm.GeneralizedAlpha(0.8), pm.HHT(0.2)]
GROWING += [pm.GeneralizedAlpha(0.5, explicit=True)]


@pytest.mark.parametrize("scheme", GROWING)
def test_damping_with_one_substep_and_algorithmic_damping_grows_and_is_warned_of(scheme):
    with pytest.warns(pm.StabilityWarning, match=r"grows with damping in .*\('a'\)"):
        coupler = damped(scheme)
    # c h / m = 0.05 feeds the velocity jump by (K8): 3e-5 for rho = 0.8, up to 2e-2
    assert pm.analysis.spectral_radius(pm.analysis.amplification_matrix(coupler)) > 1.0 + 1e-5


def test_other_damping_does_not_grow():
    undamped = [pm.Newmark(), pm.Newmark(beta=0.3, gamma=0.6), pm.CentralDifference()]
    undamped += [pm.GeneralizedAlpha(1.0), pm.GeneralizedAlpha(1.0, explicit=True)]
    with_substeps = [(pm.GeneralizedAlpha(0.5, explicit=x), 2) for x in (False, True)]
    for scheme, substeps in [*((x, 1) for x in undamped), *with_substeps]:
        for c in (0.01, 0.1, 1.0):
            G = pm.analysis.amplification_matrix(damped(scheme, c, substeps))
            # rounding of simple eigenvalues
            assert pm.analysis.spectral_radius(G) < 1.0 + 1e-12, (scheme, substeps, c)


def test_loads_damping_and_prescribed_motion_have_order_two():
    """A damped oscillator driven by its support and a load, against an adaptive integration."""
    from scipy.integrate import solve_ivp

    def g(t):
        return np.array([np.sin(2.0 * t) ** 2])

    def force(t):
        return np.array([0.0, np.sin(3.0 * t)])

    K, C = np.array([[9.0, -9.0], [-9.0, 9.0]]), np.array([[0.4, -0.4], [-0.4, 0.4]])

    def slope(t, y):
        # y = u_0, u_1, v_1: dof 0 has the prescribed velocity
        v = np.array([g(t)[0], y[2]])
        return [v[0], y[2], (force(t) - K @ y[:2] - C @ v)[1] / 2.0]

    reference = solve_ivp(slope, (0.0, 2.0), [0.0, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-14)
    errors = []
    for n in (100, 200):
        frame = pm.Subdomain(
            [1.0, 2.0], K, C=C, scheme=pm.Newmark(), substeps=3, force=force, name="frame"
        )
        support = pm.Constraint({frame: [[1.0, 0.0]]}, velocity=g)
        history = pm.Coupler([frame], support, dt=2.0 / n, coupling="mean").run(2.0)
        errors.append(np.max(np.abs(history["frame"].u[-1] - reference.y[:2, -1])))
    assert_order(errors, 1.9, np.inf, ["u of the frame"])


def oscillators(b, substeps, schemes, h, *, double=False):
    """The split oscillator: masses 1 and b, stiffness 1 and b, with the critical step of B."""
    A = pm.Subdomain([1.0], [1.0], scheme=schemes[0], double_step=double or None, name="A")
    B = pm.Subdomain([b], [b * substeps**2], scheme=schemes[1], substeps=substeps, name="B")
    return pm.Coupler([A, B], pm.tie(A, 0, B, 0), dt=h, coupling="mean")


def test_no_coupled_step_is_unstable():
    """1 + 1e-7: double eigenvalues of modulus one are computed to the root of the rounding."""
    kinds = pairwise([0.5, 0.8, 1.0], [False, True], [False, True])
    for kind, b, substeps, k in pairwise(kinds, [0.01, 1.0, 100.0], [1, 2, 5, 20], [0, 1, 2]):
        rho, explicit, double = kind
        schemes = [pm.GeneralizedAlpha(rho), pm.GeneralizedAlpha(rho, explicit=explicit)]
        alone = pm.Subdomain([1.0], [float(substeps**2)], scheme=schemes[1])
        limit = pm.analysis.critical_step(alone)
        steps = [0.1, 1.0, 10.0] if np.isinf(limit) else limit * substeps * np.r_[0.1, 0.5, 0.97]
        coupler = oscillators(b, substeps, schemes, steps[k], double=double)
        G = pm.analysis.amplification_matrix(coupler)
        assert pm.analysis.spectral_radius(G) < 1.0 + 1e-7, (kind, b, substeps, k)


def unnamed(scheme):
    """The same four numbers, without the rho that they are made of."""
    return pm.Scheme(scheme.am, scheme.af, scheme.beta, scheme.gamma, scheme.explicit)


@pytest.mark.parametrize("rho", [0.5, 0.6, 1.0])
def test_a_scheme_with_the_numbers_of_generalized_alpha_is_admitted_as_that_is(rho):
    scheme = unnamed(pm.GeneralizedAlpha(rho, explicit=True))
    a, b = (pm.Subdomain([1.0], [1.0], scheme=scheme, name=name) for name in "ab")
    pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="mean")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (dict(scheme=pm.GeneralizedAlpha(0.3, explicit=True)), ValueError, "rho >= 0.5"),
        (dict(scheme=unnamed(pm.GeneralizedAlpha(0.3, explicit=True))), ValueError, "rho >= 0.5"),
        (dict(M=[1.0, 0.0], scheme=pm.GeneralizedAlpha(0.5)), ValueError, "needs mass"),
        (dict(u0=[0.0, 0.1]), pm.ConstraintError, "displacements u0 must satisfy"),
        (dict(v0=[0.0, 0.1]), pm.ConstraintError, "velocities"),
        (dict(restoring=lambda t, u, v: u), ValueError, "restoring forces in 'a'"),
        (dict(double_step=True, substeps=2), ValueError, 'coupling="mean"'),
    ],
)
def test_what_cannot_be_is_refused(change, error, message):
    values = dict(M=[1.0, 1.0], K=np.array([[2.0, -1.0], [-1.0, 1.0]]), scheme=pm.Newmark())
    a = pm.Subdomain(**{**values, **change}, name="a")
    b = pm.Subdomain(**values, name="b")
    with pytest.raises(error, match=message):
        pm.Coupler([a, b], pm.tie(a, 1, b, 1), dt=0.1, coupling="mean")


@pytest.mark.parametrize("velocity", [None, [0.0]])
def test_an_end_that_is_displaced_and_held_stays_there(velocity):
    # two masses on a spring whose other end is held at 0.001: one oscillation of 1, K = 1, M = 2
    K = np.array([[1.0, -1.0], [-1.0, 1.0]])
    a = pm.Subdomain([1.0, 1.0], K, scheme=pm.Newmark(), u0=[1e-3, 0.0], name="a")
    b = pm.Subdomain([1.0], [0.0], scheme=pm.Newmark(), name="b")
    held = pm.Constraint({a: [[1.0, 0.0]]}, velocity=velocity)
    coupler = pm.Coupler([a, b], [held, pm.tie(a, [1], b, [0])], dt=0.01, coupling="mean")
    history = coupler.run(3.0)
    assert abs(history["a"].u[:, 0] - 1e-3).max() < 1e-18  # rounding of 300 steps
    exact = 1e-3 * (1.0 - np.cos(history["b"].t / np.sqrt(2.0)))
    # (omega dt)^2 / 12 of the phase of 2.1 in 3 s, some 1e-5
    assert abs(history["b"].u[:, 0] - exact).max() < 2e-5 * 1e-3
    coupler.reset(u0={"a": [2e-3, 0.0]})
    assert coupler.run(0.1)["a"].u[-1, 0] == 2e-3


def test_a_gap_between_subdomains_is_refused_where_another_row_holds_a_displaced_end():
    a, b = (pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), u0=[x], name=str(x)) for x in (1, 2))
    rows = [pm.Constraint({a: [[1.0]]}), pm.tie(a, [0], b, [0])]
    with pytest.raises(pm.ConstraintError, match="violated in row 1 .*: -1$"):
        pm.Coupler([a, b], rows, dt=0.1, coupling="mean")
