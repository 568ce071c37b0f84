"""Invariances of a run: scale, signs, what is recorded, other couplers, the user's arrays, reset.

The results are bitwise identical. relations.py has units, orders and pieces of runs,
test_histories.py sequences of calls.
"""

import copy
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import reference
import scipy.sparse as sp
from pairwise import pairwise
from reference_problems import Problem, SubdomainData, random_problem, reference_subdomain

import pmalpha as pm

STEPS = 9
AS = {"diagonal": lambda A: np.diag(A).copy(), "dense": np.asarray, "sparse": sp.csr_array}
FORMS = list(AS)
FINE = 6


def largest(x):
    return np.max(np.abs(x), initial=0.0)


# ---- a problem with all features ------------------------------------------------------------

CONDITIONS = (
    # rows: a general constraint on three subdomains, a tie, a general one on the massless dof of a
    [[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.3, 0.0, 1.7]],
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.4, -0.6]],
    [[0.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]],
    [[0.7, 0.0], [0.0, 0.0], [0.0, 0.0]],
)
SAMPLES = np.array([0.3, -1.0, 0.7, 2.0, -0.4, 0.9])


def swing(t):
    return np.cos(3.0 * t) * np.array([1.0, 0.0, -2.0, 0.5])


def everything(form, *, coupling="pm", start="rebased"):
    """Four subdomains: all kinds of loads, single and double steps, damping, dofs without mass.

    0: implicit, double steps, an interior massless dof (2) and one on the interface (3); no load.
    1: explicit, finest step; ground acceleration that ends during the run.
    2: implicit, double steps with three substeps in a macro step; a callable.
    3: implicit, finest step; constant load. (Sampled forces: `with_sampled_forces`.)
    """
    rng = np.random.default_rng(7)
    sizes, substeps = (4, 3, 4, 2), (1, FINE, 3, FINE)
    schemes = (
        pm.GeneralizedAlpha(0.4), pm.GeneralizedAlpha(0.6, explicit=True), pm.HHT(0.2),
        pm.WBZ(0.1),
    )  # fmt: skip
    subdomains = []
    for n, ss, scheme in zip(sizes, substeps, schemes):
        M = np.diag(rng.uniform(1.0, 3.0, n))
        A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
        K = 15.0 * A @ A.T + np.diag(rng.uniform(5.0, 40.0, n))
        if form == "diagonal":
            K = np.diag(np.diag(K))
        subdomains.append(
            SubdomainData(M, K, 0.1 * M + 0.003 * K, scheme, ss, None, [AS[form]] * 3)
        )
    a, b, c, d = subdomains
    for dof in (2, 3):
        a.M[dof, dof] = 0.0
        a.C[dof, :] = a.C[:, dof] = 0.0
    b.force = pm.BaseAcceleration(SAMPLES, np.array([1.0, -0.5, 2.0]), b.forms[0](b.M), dt=0.017)
    c.force, d.force = swing, np.array([0.3, -1.1])
    L = [np.array(Li) for Li in CONDITIONS]
    states = [consistent(rng.normal(size=sum(sizes)), L) for _ in range(2)]
    for s, u0, v0 in zip(subdomains, *(np.split(x, np.cumsum(sizes)[:-1]) for x in states)):
        s.u0, s.v0 = u0, v0
    # the massless dof inside is in equilibrium: 0 = - K u in its row
    a.u0[2] -= a.K[2] @ a.u0 / a.K[2, 2]
    return Problem(subdomains, L, 0.06, start, coupling)


def consistent(x, L):
    """x projected onto the values that satisfy the constraints."""
    whole = np.hstack(L)
    return x - np.linalg.pinv(whole) @ (whole @ x)


def with_sampled_forces(problem):
    """The same with a sampled force on every subdomain without massless dofs."""
    for i, s in enumerate(problem.subdomains[1:]):
        shape = None if i == 1 else np.outer(np.arange(1.0, 1.0 + len(s.M)), [1.0, -0.3])
        values = np.outer(SAMPLES, np.ones(len(s.M) if i == 1 else 2)) + 0.1 * i
        s.force = pm.SampledForce(values, 0.023, shape=shape)
    return problem


def tied_without_mass(form):
    """Two massless dofs tied to each other, and one of them to a mass of a third subdomain."""
    K = np.array([[30.0, -20.0], [-20.0, 50.0]])
    if form == "diagonal":
        K = np.diag(np.diag(K))
    forms = [AS[form]] * 3
    soft = pm.GeneralizedAlpha(0.3)
    # in the rows of the two ties of massless dofs the forces are - 20 u and 20 u: equilibrium
    first = SubdomainData(np.diag([2.0, 0.0, 0.0]), np.zeros((3, 3)), None, soft, 1, None, forms)
    second = SubdomainData(np.diag([0.0, 1.5, 0.0]), np.zeros((3, 3)), None, soft, 2, None, forms)
    for s in (first, second):
        s.K[:2, :2] = K
        s.K[2, 2] = 25.0
        s.v0 = np.zeros(3)
    first.u0, second.u0 = np.array([0.4, 0.1, 0.2]), np.array([0.1, -0.3, 0.2])
    first.force, second.force = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 7.0])
    third = SubdomainData(np.eye(1), np.eye(1), None, soft, 2, False, forms)
    third.u0, third.v0 = np.array([0.1]), np.zeros(1)
    L = [np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 1))]
    L[0][0, 1], L[1][0, 0] = 1.0, -1.0
    L[0][1, 1], L[2][1, 0] = 1.0, -1.0
    L[0][2, 2], L[1][2, 2] = 1.0, -1.0
    return Problem([first, second, third], L, 0.05, "rebased", "pm")


PROBLEMS = {
    **{f"everything-{form}": partial(everything, form) for form in FORMS},
    **{f"sampled-{form}": lambda f=form: with_sampled_forces(everything(f)) for form in FORMS},
    **{f"tied-without-mass-{form}": partial(tied_without_mass, form) for form in FORMS},
    **{f"random-{seed}": partial(random_problem, 1000 + seed) for seed in range(5)},
}


def scaled_force(force, factor):
    if isinstance(force, pm.SampledForce):
        other = copy.copy(force)  # of either class; forces are frozen, so from inside
        object.__setattr__(other, "values", force.values * factor)
        return other
    if callable(force):
        return lambda t: force(t) * factor
    return None if force is None else force * factor


def arrays(history):
    """All arrays of a History except times: (name, array), named u, v, a, Lam, jumps."""
    found = [("Lam", history.multipliers)]
    found += [("v", history.velocity_jump), ("u", history.displacement_jump)]
    for s in history.subdomains:
        found += [("u", s.u), ("v", s.v), ("a", s.a)]
    return found


def assert_identical(one, two, factor=1.0):
    """Every result of `two` is exactly `factor` times that of `one`; the times are equal."""
    for x, y in zip(one.subdomains, two.subdomains):
        np.testing.assert_array_equal(x.t, y.t)
        np.testing.assert_array_equal(x.dofs, y.dofs)
    np.testing.assert_array_equal(one.multiplier_times, two.multiplier_times)
    np.testing.assert_array_equal(one.macro_times, two.macro_times)
    for (_, x), (_, y) in zip(arrays(one), arrays(two)):
        np.testing.assert_array_equal(factor * x, y)


def scales(history, problem):
    """The largest value of each kind; for multipliers of any force, as they may be zero."""
    scale = {"u": 0.0, "v": 0.0, "a": 0.0, "Lam": largest(history.multipliers)}
    for found, s in zip(history.subdomains, problem.subdomains):
        for x in "uva":
            scale[x] = max(scale[x], largest(getattr(found, x)))
        scale["Lam"] = max(scale["Lam"], largest(found.a @ s.M), largest(found.u @ s.K))
    return scale


# ---- scale ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "k"), [(make, (-40, 7, 60)[i % 3]) for i, make in enumerate(PROBLEMS.values())]
)
def test_loads_and_initial_values_times_a_power_of_two_scale_every_result_exactly(make, k):
    problem, factor = make(), 2.0**k
    scaled = replace(problem, subdomains=[replace(s) for s in problem.subdomains])
    for s in scaled.subdomains:
        s.u0 = None if s.u0 is None else s.u0 * factor
        s.v0 = None if s.v0 is None else s.v0 * factor
        s.force = scaled_force(s.force, factor)
    one, two = problem.coupler().run(steps=STEPS), scaled.coupler().run(steps=STEPS)
    assert_identical(one, two, factor)


# ---- order and sign -------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_rows_in_one_constraint_or_in_several_are_bitwise_identical(form):
    one, two = (trio(form, split) for split in (False, True))
    assert_identical(one.run(steps=STEPS), two.run(steps=STEPS))


def trio(form, split):
    """Three subdomains in a row, tied at two dofs in one Constraint or in two ties."""
    a, b, c = (_plain(form, name) for name in "abc")
    if split:
        return pm.Coupler(
            [a, b, c], [pm.tie(a, [0], b, [1]), pm.tie(b, [2], c, [0])], dt=0.02, coupling="pm"
        )
    L = np.zeros((3, 2, 3))
    L[0, 0, 0], L[1, 0, 1], L[1, 1, 2], L[2, 1, 0] = 1.0, -1.0, 1.0, -1.0
    return pm.Coupler([a, b, c], pm.Constraint(dict(zip((a, b, c), L))), dt=0.02, coupling="pm")


def _plain(form, name, **options):
    """Three coupled dofs, implicit."""
    K = AS[form](20.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)))
    options = {"scheme": pm.GeneralizedAlpha(0.5), **options}
    force = {"a": [1.0, 2.0, 3.0], "b": [-1.0, 0.0, 1.0], "c": [0.5, 0.25, 4.0]}[name]
    return pm.Subdomain([1.0, 2.0, 1.5], K, name=name, **{"force": force, **options})


@pytest.mark.parametrize("form", FORMS)
def test_a_tie_the_other_way_round_changes_the_sign_of_its_multiplier_alone(form):
    def history(turned):
        a = _plain(form, "a")
        b = _plain(form, "b", substeps=4, scheme=pm.CentralDifference())
        constraint = pm.tie(b, [0, 2], a, [1, 2]) if turned else pm.tie(a, [1, 2], b, [0, 2])
        return pm.Coupler([a, b], constraint, dt=0.02, coupling="pm").run(steps=20)

    one, two = history(False), history(True)
    for x, y in zip(one.subdomains, two.subdomains):
        np.testing.assert_array_equal(x.u, y.u)
        np.testing.assert_array_equal(x.a, y.a)
    np.testing.assert_array_equal(one.multipliers, -two.multipliers)
    np.testing.assert_array_equal(one.displacement_jump, -two.displacement_jump)
    assert np.abs(one.multipliers).max() > 0.1  # forces of size 1


def test_a_positive_multiplier_pushes_the_first_and_pulls_the_second():
    a = pm.Subdomain([2.0], [0.0], scheme=pm.Newmark())
    b = pm.Subdomain([1.0], [0.0], scheme=pm.Newmark(), force=[6.0])
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm")
    # both accelerate by 6 / 3 = 2; a needs the force 2 * 2 for that; a rounding or two
    np.testing.assert_allclose(coupler.multipliers, [4.0], rtol=1e-15)
    np.testing.assert_allclose(coupler.run(steps=3).multipliers, 4.0, rtol=1e-14)


# ---- run, step, record ----------------------------------------------------------------------

SCHEDULES = [("pm", "rebased"), ("pm", "plain"), ("gc", "rebased")]


def joined(histories):
    """The arrays of several intervals as one; each begins where the one before ended."""
    for before, after in zip(histories, histories[1:]):
        for (_, x), (_, y) in zip(arrays(before), arrays(after)):
            np.testing.assert_array_equal(x[-1], y[0])
    pieces = zip(*([x for _, x in arrays(h)] for h in histories))
    return [np.concatenate([p[0], *(x[1:] for x in p[1:])]) for p in pieces]


@pytest.mark.parametrize("form", FORMS)
def test_record_keeps_exactly_the_given_columns(form):
    whole = everything(form).coupler().run(steps=STEPS)
    coupler = everything(form).coupler()
    some = coupler.run(steps=STEPS, record={"subdomain 0": [3, 0], 2: None})
    for x in "uva":
        np.testing.assert_array_equal(getattr(some[0], x), getattr(whole[0], x)[:, [3, 0]])
        np.testing.assert_array_equal(getattr(some[2], x), getattr(whole[2], x))
    np.testing.assert_array_equal(some[0].dofs, [3, 0])
    np.testing.assert_array_equal(some[0].t, whole[0].t)
    for name in ("multipliers", "velocity_jump", "displacement_jump"):
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name))
    for i in (1, 3):
        assert some.subdomains[i] is None
        with pytest.raises(KeyError, match=f"subdomain {i}"):
            some[i]
    np.testing.assert_array_equal(coupler.state(1).u, whole[1].u[-1])


@pytest.mark.parametrize(("begin", "every"), [(0, 1), (0, 4), (1, 2), (4, 4), (1, 100)])
def test_every_keeps_the_first_time_level_and_multiples_of_macro_steps(begin, every):
    whole = everything("dense").coupler().run(steps=begin + 11)
    coupler = everything("dense").coupler()
    coupler.step(begin)
    some = coupler.run(steps=11, every=every)
    # the first time level of the interval, then multiples of `every`
    macro = [begin] + [n for n in range(begin + 1, begin + 12) if n % every == 0]
    np.testing.assert_array_equal(some.macro_times, whole.macro_times[macro])
    np.testing.assert_array_equal(some.displacement_jump, whole.displacement_jump[macro])
    fine = np.array(macro) * FINE
    np.testing.assert_array_equal(some.multiplier_times, whole.multiplier_times[fine])
    np.testing.assert_array_equal(some.multipliers, whole.multipliers[fine])
    np.testing.assert_array_equal(some.velocity_jump, whole.velocity_jump[fine])
    for i, s in enumerate(everything("dense").subdomains):
        rows = np.array(macro) * s.substeps
        for x in ("t", "u", "v", "a"):
            np.testing.assert_array_equal(getattr(some[i], x), getattr(whole[i], x)[rows])
    np.testing.assert_array_equal(coupler.state(0).u, whole[0].u[-1])


@pytest.mark.parametrize(
    ("coupling", "kinds", "substeps", "same_as"),
    [
        ("pm", "ie", (1, 4), (True, False)),  # implicit and coarser than the finest
        ("pm", "iei", (1, 4, 2), (True, False, True)),
        ("pm", "ei", (1, 4), (False, False)),  # explicit: its limit would be half
        ("pm", "eii", (1, 1, 1), (False, True, False)),  # equal steps: the first implicit one
        ("pm", "ee", (1, 1), (False, False)),
        ("gc", "ie", (1, 4), (False, False)),
    ],
)
def test_which_subdomains_take_double_steps_by_default(coupling, kinds, substeps, same_as):
    def history(double, coupling=coupling):
        schemes = [pm.GeneralizedAlpha(0.5, explicit=kind == "e") for kind in kinds]
        subdomains = [
            _plain("dense", name, scheme=scheme, substeps=ss, double_step=d)
            for name, scheme, ss, d in zip("abc", schemes, substeps, double)
        ]
        ties = [pm.tie(one, [0], two, [1]) for one, two in zip(subdomains, subdomains[1:])]
        return pm.Coupler(subdomains, ties, dt=0.02, coupling=coupling).run(steps=STEPS)

    default = history([None] * len(kinds))
    assert_identical(default, history(same_as, "pm"))
    if coupling == "gc":  # none, whatever is set
        assert_identical(default, history((True, False)))
    other = (not same_as[0], *same_as[1:])
    if not all(d for d, ss in zip(other, substeps) if ss == max(substeps)):
        assert (history(other, "pm")[0].a != default[0].a).any()


# ---- ownership of arrays ----------------------------------------------------------------------


def frozen(value):
    """A comparable copy of all data of a subdomain."""
    if sp.issparse(value):
        return value.shape, value.data.tolist(), value.indices.tolist(), value.indptr.tolist()
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("form", FORMS)
def test_couplers_made_of_the_same_subdomains_are_independent(form):
    def subdomains():
        a = _plain(form, "a", u0=[1.0, 0.0, 0.5])
        b = _plain(form, "b", substeps=3, scheme=pm.CentralDifference(), u0=[0.0, 1.0, 0.0])
        return a, b

    def couplers(pairs):
        options = [(0.02, "pm"), (0.02, "pm"), (0.05, "gc")]
        made = zip(pairs, options)
        return [
            pm.Coupler([a, b], pm.tie(a, [0], b, [1]), dt=dt, coupling=coupling)
            for (a, b), (dt, coupling) in made
        ]

    alone = [c.run(steps=12) for c in couplers([subdomains() for _ in range(3)])]
    given = subdomains()
    before = [{k: frozen(v) for k, v in vars(s).items()} for s in given]
    same = couplers([given] * 3)
    # a later run leaves the history of an earlier one alone
    intervals = [[c.run(steps=n) for c in same] for n in (5, 1, 6)]
    for h, pieces in zip(alone, zip(*intervals)):
        for x, (_, y) in zip(joined(pieces), arrays(h)):
            np.testing.assert_array_equal(x, y)
    assert (alone[0][0].u != alone[2][0].u).any()
    free = {"b": [0.0, 0.0, 1.0]}
    same[0].reset(u0=free | {"a": [0.0, 0.0, 9.0]}, v0=free, force={"b": None})
    same[0].step(3)
    assert [{k: frozen(v) for k, v in vars(s).items()} for s in given] == before


def users_arrays(form):
    """Every array that a user passes, by name."""
    K = 20.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))
    C = sp.csc_matrix(0.01 * K) if form == "sparse" else AS[form](0.01 * K).copy()
    return {
        "M": np.array([1.0, 2.0, 1.5]), "K": AS[form](K), "C": C,
        "u0": np.full(3, 0.5), "v0": np.full(3, 0.2),  # they satisfy the constraints below
        "constant": np.array([0.1, 0.2, 0.3]),
        "values": np.array([[1.0, 2.0], [3.0, 0.5], [2.0, 1.0]]),
        "shape": np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 2.0]]),
        "record": np.array([0.0, 5.0, 1.0, 2.0]), "direction": np.array([1.0, 1.0, 0.5]),
        "L_dense": np.array([[0.5, 0.5, 0.0]]), "L_sparse": sp.csr_array([[-1.0, 0.0, 0.0]]),
        "dofs_a": np.array([1]), "dofs_b": np.array([2]), "recorded": np.array([2, 0]),
    }  # fmt: skip


def coupler_of(x, spoil):
    """A coupler of these arrays; `spoil` is called on arrays as soon as they were passed."""
    sampled = pm.SampledForce(x["values"], 0.05, shape=x["shape"])
    spoil("values", "shape")
    ground = pm.BaseAcceleration(x["record"], x["direction"], x["M"], dt=0.05)
    spoil("record", "direction")
    matrices = {name: x[name] for name in "MKC"}
    soft = {"u0": x["u0"], "v0": x["v0"], "scheme": pm.GeneralizedAlpha(0.5)}
    fast = {**soft, "scheme": pm.CentralDifference()}
    a = pm.Subdomain(**matrices, force=sampled, name="a", **soft)
    b = pm.Subdomain(**matrices, force=ground, substeps=2, name="b", **soft)
    c = pm.Subdomain(**matrices, force=x["constant"], substeps=4, **fast)
    spoil("M", "K", "C", "u0", "v0", "constant")
    general = pm.Constraint({a: x["L_dense"], c: x["L_sparse"]})
    ties = [general, pm.tie(b, x["dofs_a"], c, x["dofs_b"])]
    spoil("L_dense", "L_sparse", "dofs_a", "dofs_b")
    return pm.Coupler([a, b, c], ties, dt=0.02, coupling="pm")


def numbers(x):
    return x.data if sp.issparse(x) else x


@pytest.mark.parametrize("form", FORMS)
def test_the_users_arrays_are_neither_changed_nor_read_again(form):
    x = users_arrays(form)
    for value in x.values():  # which are accepted too
        numbers(value).setflags(write=False)
    before = {name: frozen(value) for name, value in x.items()}
    whole = coupler_of(x, lambda *names: None)
    expected = whole.run(steps=20, record={"a": x["recorded"], "b": None, 2: None})
    assert {name: frozen(value) for name, value in x.items()} == before

    y = users_arrays(form)

    def spoil(*names):
        for name in names:
            numbers(y[name])[:] = -7
            if sp.issparse(y[name]):
                y[name].indices[:] = 0

    coupler = coupler_of(y, spoil)
    assert_identical(expected, coupler.run(steps=20, record={"a": [2, 0], "b": None, 2: None}))
    # changed before they are passed, they define another problem or an invalid one
    with pytest.raises((ValueError, pm.PmalphaError)):
        coupler_of(y, lambda *names: None)


# ---- reset ----------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_reset_with_other_values_equals_a_new_coupler(form):
    def coupler(u_a, v_b, force_a, force_b):
        a = _plain(form, "a", u0=u_a, force=force_a)
        b = _plain(form, "b", substeps=4, v0=v_b, force=force_b)
        return pm.Coupler([a, b], pm.tie(a, [1], b, [1]), dt=0.02, coupling="pm")

    def turn(t):
        return np.array([np.sin(9.0 * t), 1.0, t])

    ramp = pm.SampledForce([0.0, 1.0], 0.1, shape=[1.0, 0.0, 2.0])
    values = [
        ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], None, ramp),
        ([0.0, 0.0, 2.0], [3.0, 0.0, 0.0], turn, None),
        ([0.0, 0.0, 0.0], [3.0, 0.0, 0.5], ramp, turn),
        ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], np.array([1.0, 2.0, 3.0]), None),
    ]
    coupler_to_reset = coupler(*values[0])
    coupler_to_reset.step(3)
    for u_a, v_b, force_a, force_b in values[1:]:
        coupler_to_reset.reset(u0={"a": u_a}, v0={1: v_b}, force={"a": force_a, "b": force_b})
        expected = coupler(u_a, v_b, force_a, force_b).run(steps=STEPS)
        assert_identical(expected, coupler_to_reset.run(steps=STEPS))


# ---- velocity jumps -------------------------------------------------------------------------


def jump_from_states(problem, history, doubles):
    """sum_i L_i v_i at every fine instant, from recorded states, multipliers and the reference.

    At a time level of a subdomain this is its velocity. In between it is the interpolated free
    velocity (15) plus the link velocity of the instant; the free velocity at a time level is the
    velocity less the link velocity. All link velocities are solved for anew.
    """
    total = np.zeros_like(history.velocity_jump)
    for s, L, recorded, double in zip(problem.subdomains, problem.L, history.subdomains, doubles):
        same = reference_subdomain(s, double)
        h, stride = problem.dt / s.substeps, FINE // s.substeps
        single = reference.Step(same, L, h)
        later = reference.Step(same, L, 2.0 * h if double else h)

        def link(step, k, Lam=history.multipliers):
            return step.link(Lam[k])[1]

        for k in range(len(total)):
            n, j = divmod(k, stride)
            if j == 0:
                total[k] += L @ recorded.v[n]
                continue
            step = single if k < FINE else later
            rebased = step if problem.start == "rebased" else single
            before = rebased if n * stride == FINE else step  # (S3)
            vf = [recorded.v[n] - link(before, n * stride)]
            vf += [recorded.v[n + 1] - link(step, (n + 1) * stride)]
            theta = j / stride
            total[k] += L @ ((1.0 - theta) * vf[0] + theta * vf[1] + link(step, k))
    return total


def jump_at_macro_steps(problem, history, name):
    """sum_i L_i x_i at the ends of macro steps, where every subdomain has a state."""
    rows = zip(history.subdomains, problem.subdomains, problem.L)
    return sum(getattr(x, name)[:: s.substeps] @ L.T for x, s, L in rows)


def wrong_interface_matrix(factor):
    """pmalpha.setup.assembly.interface_matrix with one entry of H changed."""
    right = pm.setup.assembly.interface_matrix

    def wrong(*args, **kwargs):
        H = right(*args, **kwargs)
        if H.ndim == 1:
            H = H.copy()
            H[0] *= factor
        else:
            H = H.tolil() if sp.issparse(H) else H.copy()
            H[0, 0] *= factor
            H = sp.csr_array(H) if sp.issparse(H) else H
        return H

    return wrong


DOUBLES = {"pm": (True, False, True, False), "gc": (False,) * 4}


@pytest.mark.parametrize(("coupling", "start"), SCHEDULES)
@pytest.mark.parametrize("form", FORMS)
def test_jumps_are_those_of_the_states_and_of_velocities_rounding_alone(form, coupling, start):
    problem = everything(form, coupling=coupling, start=start)
    history = problem.coupler().run(steps=STEPS)
    scale = scales(history, problem)["v"]
    # a few roundings of velocities of this size, each one a sum over some dofs
    assert largest(history.velocity_jump) <= 1e-13 * scale
    # the reference solves for link velocities by other sums: condition number of Mbar at most 100
    again = jump_from_states(problem, history, DOUBLES[coupling])
    assert largest(again) <= 1e-12 * scale
    # at the ends of macro steps all subdomains have states: without free and link velocities
    total = jump_at_macro_steps(problem, history, "v")
    assert largest(total) <= 1e-13 * scale
    # the same sum in another order
    np.testing.assert_allclose(history.velocity_jump[::FINE], total, rtol=0, atol=1e-14 * scale)
    total, size = jump_at_macro_steps(problem, history, "u"), scales(history, problem)["u"]
    np.testing.assert_allclose(history.displacement_jump, total, rtol=0, atol=1e-14 * size)
    assert largest(history.displacement_jump) > 1e-6 * size  # there is a drift


@pytest.mark.parametrize(
    ("form", "schedule", "factor"), pairwise(FORMS, SCHEDULES, [1.0 + 1e-6, 1.5])
)
def test_a_wrong_entry_of_H_causes_a_velocity_jump(form, schedule, factor, monkeypatch):
    coupling, start = schedule
    monkeypatch.setattr("pmalpha.setup.assembly.interface_matrix", wrong_interface_matrix(factor))
    problem = everything(form, coupling=coupling, start=start)
    history = problem.coupler().run(steps=STEPS)
    scale = scales(history, problem)["v"]
    # a factor 1 + e on a diagonal entry of H leaves e H_00 Lam_0 of the jump: al2 Lam / m is about
    # h w, a tenth of the velocities or more
    jump = np.abs(history.velocity_jump[1:, 0]).max()
    assert jump > 0.01 * (factor - 1.0) * scale
    # and the reported jump is that of the states, rounding as above
    again = jump_from_states(problem, history, DOUBLES[coupling])
    assert largest(history.velocity_jump - again) <= 1e-12 * scale


# ---- equilibrium at time levels -------------------------------------------------------------


@pytest.mark.parametrize(("coupling", "start"), SCHEDULES)
@pytest.mark.parametrize("form", FORMS)
def test_every_subdomain_is_in_equilibrium_at_its_time_levels(form, coupling, start):
    problem = everything(form, coupling=coupling, start=start)
    history = problem.coupler().run(steps=STEPS)
    largest_force = scales(history, problem)["Lam"]
    together = zip(problem.subdomains, problem.L, history.subdomains, DOUBLES[coupling])
    for s, L, x, double in together:
        assert len(x.t) == STEPS * s.substeps + 1
        F = np.array([_load(s.force, t, len(s.M)) for t in x.t])
        Lam = history.multipliers[:: FINE // s.substeps]
        u = x.u.copy()
        if s.scheme.explicit:  # (10) has K ut, and ut = u - al1 w
            h = problem.dt / s.substeps * (1.0 + (np.arange(len(x.t)) > s.substeps) * double)
            al1 = np.array([s.scheme.coefficients(hi)[0] for hi in h])
            u[1:] -= (al1[:, None] * x.a)[1:]
        left = x.a @ s.M + x.v @ s.C + u @ s.K - F - Lam @ L
        # rounding of forces of this size, through a solve of condition number at most 100
        assert largest(left) <= 1e-12 * largest_force


def _load(force, t, n):
    if force is None:
        return np.zeros(n)
    return force(t) if callable(force) else force


def test_an_uncoupled_run_inside_a_coupler_equals_solve():
    # single steps in all subdomains, as in solve; "pm" would select a double step
    problem = everything("sparse", coupling="gc")
    names = "scheme", "substeps", "force", "u0", "v0"
    subdomains = [
        pm.Subdomain(s.M, s.K, C=s.C, **{x: getattr(s, x) for x in names})
        for s in problem.subdomains[1:]
    ]
    together = pm.Coupler(subdomains, dt=0.06, coupling="gc").run(steps=STEPS)
    assert together.multipliers.shape == (STEPS * FINE + 1, 0)
    for found, s in zip(together.subdomains, subdomains):
        alone = pm.solve(s, dt=0.06, steps=STEPS)
        for x in ("u", "v", "a"):
            np.testing.assert_array_equal(getattr(found, x), getattr(alone, x))
        # T1 counts in substeps of the finest: two roundings
        np.testing.assert_allclose(found.t, alone.t, rtol=4e-16)
