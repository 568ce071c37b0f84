"""A multiple of a constraint is the same constraint: no result depends on the scale of a row."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import analysis
from pmalpha.run.checkpoint import reordered

ROWS = 4
COUPLINGS = ["gc", "pm", "macro", "mean"]
# Powers of two change no digit of anything; of other factors the rounding of a row is left.
EXACT = 2.0 ** np.array([14, 0, -13, 3])
FAR = np.array([1e6, 1.0, 1e-6, 3.0])
TIME = 0.4


def stiffness(rng, n):
    A = rng.normal(size=(n, n))
    return 20.0 * A @ A.T / n + np.eye(n)


def velocities(kind):
    """sin 3t in some form of the four rows, of which the last one moves, times a factor."""
    record = np.sin(3.0 * 0.02 * np.arange(30))
    last = np.eye(ROWS)[-1]
    return {
        None: lambda factor: None,
        "constant": lambda factor: 0.5 * factor * last,
        "callable": lambda factor: lambda t: factor * last * np.sin(3.0 * t),
        "sampled": lambda factor: pm.SampledForce(np.outer(record, factor * last), 0.02),
        "shaped": lambda factor: pm.SampledForce(record, 0.02, shape=factor * last),
    }[kind]


def coupler(factor, coupling="gc", *, internal=False, velocity=None):
    """Two subdomains tied by a tie, two general rows, and one on one of them alone."""
    rng = np.random.default_rng(5)
    springs = [pm.CubicSpring([0, 1], k=[1.0, 2.0], k3=[30.0, 40.0])] if internal else None
    a = pm.Subdomain(
        np.ones(5), stiffness(rng, 5), scheme=pm.Newmark(), substeps=2, force=np.ones(5),
        internal=springs, name="a",
    )  # fmt: skip
    b = pm.Subdomain(
        np.ones(4), stiffness(rng, 4), scheme=pm.GeneralizedAlpha(0.6), name="b",
        v0=[0.0, 0.0, 0.0, 0.5 * (velocity == "constant")],
    )  # fmt: skip
    L_a = np.zeros((ROWS, 5))
    L_a[0, 0] = 1.0
    L_a[1:3, 1:] = rng.normal(size=(2, 4))
    L_b = np.zeros((ROWS, 4))
    L_b[0, 1] = -1.0
    L_b[1:3, :2] = rng.normal(size=(2, 2))
    L_b[3, 3] = 1.0
    rows = {a: factor[:, None] * L_a, b: factor[:, None] * L_b}
    constraint = pm.Constraint(rows, velocity=velocities(velocity)(factor))
    return pm.Coupler([a, b], constraint, dt=0.02, coupling=coupling)


def results(history, factor):
    """All that a History has, with multipliers and jumps of rows without the factor."""
    of_rows = {
        "multipliers": history.multipliers * factor,
        "velocity_jump": history.velocity_jump / factor,
        "displacement_jump": history.displacement_jump / factor,
    }
    return of_rows | {f"{x} of {k}": getattr(history[k], x) for k in "ab" for x in "uva"}


def require_equal(one, two, tolerance=0.0, but=()):
    for name in one.keys() - set(but):
        largest = np.max(np.abs(one[name]))
        off = np.max(np.abs(one[name] - two[name]))
        assert off <= tolerance * largest, f"{name} differs by {off:.1e} of {largest:.1e}"


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("internal", [False, True])
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_no_digit_depends_on_powers_of_two(coupling, internal):
    one = coupler(np.ones(ROWS), coupling, internal=internal).run(TIME)
    two = coupler(EXACT, coupling, internal=internal).run(TIME)
    require_equal(results(one, 1.0), results(two, EXACT))


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_nothing_but_rounding_depends_on_factors_that_are_far_apart(coupling):
    # rounding, 2e-16, magnified by the condition of H, 1e3 (mean: a velocity jump at -1 keeps it)
    one = coupler(np.ones(ROWS), coupling).run(TIME)
    two = coupler(FAR, coupling).run(TIME)
    jumps = ["velocity_jump", "displacement_jump"]  # rounding themselves
    require_equal(results(one, 1.0), results(two, FAR), 1e-11, but=jumps)


@pytest.mark.parametrize("kind", ["constant", "callable", "sampled", "shaped"])
def test_prescribed_velocities_are_those_of_the_rows(kind):
    one = coupler(np.ones(ROWS), velocity=kind)
    two = coupler(EXACT, velocity=kind)
    require_equal(results(one.run(TIME), 1.0), results(two.run(TIME), EXACT))
    assert abs(two.state("b").v[3]) > 0.1  # it moves


@pytest.mark.parametrize("kind", ["constant", "callable", "sampled", "shaped"])
def test_a_prescribed_velocity_is_that_of_a_row_of_which_none_has_the_size_one(kind):
    given = velocities(kind)(5.0 * np.ones(ROWS))
    expected = np.full(21, 0.5) if kind == "constant" else np.sin(3.0 * 0.02 * np.arange(21))
    v0 = [0.0, 0.0, 0.0, expected[0]]
    a = pm.Subdomain(np.ones(ROWS), np.ones(ROWS), scheme=pm.Newmark(), v0=v0)
    rows = pm.Constraint({a: 5.0 * np.eye(ROWS)}, velocity=given)
    v = pm.Coupler([a], rows, dt=0.02, coupling="gc").run(0.4)[0].v
    # 5 v = 5 g up to a rounding of the multiplier
    np.testing.assert_allclose(v[:, -1], expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_a_saved_state_and_one_in_memory_have_the_rows_of_the_user(tmp_path, coupling):
    whole = coupler(EXACT, coupling, internal=True)
    whole.step(20)
    one, two = (coupler(EXACT, coupling, internal=True) for _ in range(2))
    one.step(7)
    kept = one.snapshot()
    one.save(tmp_path / "state.npz")
    one.step(2)
    one.restore(kept)
    two.load(tmp_path / "state.npz")
    plain = coupler(np.ones(ROWS), coupling, internal=True)
    plain.step(7)
    assert np.array_equal(two.multipliers * EXACT, plain.multipliers)
    plain.save(tmp_path / "plain.npz")
    with np.load(tmp_path / "state.npz") as scaled, np.load(tmp_path / "plain.npz") as own:
        assert np.array_equal(scaled["multipliers"] * EXACT, own["multipliers"])
    for other in (one, two):
        other.step(13)
        assert np.array_equal(other.multipliers, whole.multipliers)
        assert np.array_equal(other.state("a").u, whole.state("a").u)


@pytest.mark.parametrize("pairs", [False, True])
def test_what_shooting_continues_with_is_a_map_of_jumps_to_multipliers(pairs):
    # B r of the user's rows is that of the core's, whose jumps are r / s and multipliers Lam s
    rng, p, s = np.random.default_rng(0), 3, np.array([4.0, 0.5, 2.0])
    order = np.array([2, 0, 1])
    tail = np.concatenate([[2.0], rng.normal(size=4 * p)]) if pairs else rng.normal(size=p * p)
    core = np.concatenate([[7.0], rng.normal(size=p), tail])
    user = reordered(core, order, s)
    assert np.array_equal(user[1 : 1 + p] * s, core[1 : 1 + p][order])

    def learned(state, x):
        """What the state makes of x: multipliers, those of H^-1 r where there are pairs."""
        rest = state[1 + p :]
        if not pairs:
            return rest.reshape(p, p) @ x
        for a, t in rest[1:].reshape(-1, 2, p):
            x = x + a * (t @ x)
        return x

    x = rng.normal(size=p)
    given = x[order] / s if pairs else x[order] * s
    assert np.allclose(learned(user, given) * s, learned(core, x)[order], rtol=1e-14)
    back = reordered(user, np.argsort(order), 1.0 / s[np.argsort(order)])
    assert np.array_equal(back, core)


def test_cases_side_by_side_have_the_rows_of_the_user():
    cases = [{"force": {"a": k * np.ones(5)}} for k in (1.0, 2.0, 3.0)]
    histories = coupler(EXACT, "pm", velocity="sampled").run_each(cases, TIME)
    plain = coupler(np.ones(ROWS), "pm", velocity="sampled").run_each(cases, TIME)
    for one, two in zip(plain, histories):
        require_equal(results(one, 1.0), results(two, EXACT))


def test_analyses_have_the_rows_of_the_user():
    one, two = coupler(np.ones(ROWS), "macro"), coupler(EXACT, "macro")
    G, scaled = map(analysis.amplification_matrix, (one, two))
    s = np.ones(len(G))
    s[-ROWS:] = EXACT
    assert np.array_equal(scaled * s[:, None] / s, G)
    # the exact solution is computed by SVD and pinv of the rows as they are: rounding, 1e-12
    errors = [analysis.local_error(c, analysis.exact_solution(c)) for c in (one, two)]
    for name in "uva":
        assert errors[0][name] == pytest.approx(errors[1][name], rel=1e-6)


@pytest.mark.parametrize("internal", [False, True])
@pytest.mark.parametrize("factor", [FAR, np.array([1e9, 1.0, 1e-9, 1e9])])
def test_statics_and_the_assembled_structure_do_not_depend_on_factors(factor, internal):
    one, two = (coupler(f, internal=internal) for f in (np.ones(ROWS), factor))
    u, scaled = one.static(), two.static()
    for name in "ab":  # rounding of a condition number of 1e3; of Newton's method, its last digits
        assert np.allclose(scaled[name], u[name], rtol=0.0, atol=1e-12)
    assert np.allclose(one.modes(3)[0], two.modes(3)[0], rtol=1e-11)


def test_messages_have_the_rows_of_the_user():
    a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), u0=[1.0], name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name="b")
    rows = pm.Constraint({a: [[100.0]], b: [[-100.0]]})
    with pytest.warns(pm.ConstraintWarning, match="row 0: 100$"):
        pm.Coupler([a, b], rows, dt=0.1, coupling="pm")


@pytest.mark.parametrize("size", [5e-324, 1e-310])
def test_a_row_too_small_for_its_multiplier_is_refused_by_name(size):
    a, b = (pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), name=x) for x in "ab")
    tie = pm.Constraint({a: [[1.0]], b: [[-1.0]]})
    small = pm.Constraint({a: [[size]]})
    words = rf"at least 1e-300, got {size:g} in row 1 \(row 0 of constraint 1\)"
    with pytest.raises(pm.ConstraintError, match=words):
        pm.Coupler([a, b], [tie, small], dt=0.1, coupling="gc")
