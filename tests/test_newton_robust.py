"""Stiff problems in every schedule with the default control, and interfaces of hundreds of rows.

The short form of the tables of docs/method.md, section 14, measured with the core.
"""

import newton_chains
import numpy as np
import pytest
import scipy.sparse as sp
from newton_coupled import coupler
from newton_problems import chain, pendulum, pendulum_error
from newton_reference import run_macro
from pairwise import in_turn, pairwise
from test_elements_motion import held

import pmalpha as pm
from pmalpha import structures

# omega h of 10 to 400, no double step damped: long steps on purpose
pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

SCHEDULES = newton_chains.SCHEDULES
PROBLEMS = newton_chains.problems()
# problem, its number, most iterations a substep: 1.5 times those of the page
STIFF = [("plastic chain", 0, 7.5), ("plastic chain", 1, 7.5), ("stiff cubic chain", 1, 11.0)]


def run_of(subdomains, L, dt, steps, schedule, **newton):
    """The History of a problem in a schedule of newton_chains."""
    macro = SCHEDULES[schedule][0] is run_macro
    coupling = "macro" if macro else "pm" if subdomains[0].double else "gc"
    c = coupler(subdomains, L, dt, coupling, newton=pm.Newton(**newton))
    return c.run(steps=steps)


# ---- no failure in any schedule ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("schedule", "stiff", "tangent"), pairwise(list(SCHEDULES), STIFF, ["full", "reuse"])
)
def test_stiff_chains_converge_in_every_schedule(schedule, stiff, tangent):
    problem, number, most = stiff
    law, values, dts, _ = PROBLEMS[problem]
    subdomains, L = chain(newton_chains.N, law, **values, **SCHEDULES[schedule][1])
    history = run_of(subdomains, L, dts[number], 30, schedule, tangent=tangent)
    total = sum(x.iterations.sum() for x in history)
    substeps = sum(len(x.t) - 1 for x in history)
    factor = 3.0 if "macro" in schedule else 1.0  # passes
    # with kept tangents twice as many
    assert total / substeps < most * factor * (2.0 if tangent == "reuse" else 1.0)
    if history["0"].q is not None:
        assert abs(history["0"].q).max() > 0.01  # it has yielded


@pytest.mark.parametrize(("schedule", "tangent"), in_turn(SCHEDULES, "full", "reuse"))
def test_contact_of_high_penalty_keeps_its_velocity_with_rho_0(schedule, tangent):
    law, values, (dt,), _ = PROBLEMS["penalty contact, rho 0"]  # omega_c dt = 400
    subdomains, L = chain(newton_chains.N, law, **values, **SCHEDULES[schedule][1])
    history = run_of(subdomains, L, dt, 50, schedule, tangent=tangent)
    assert max(abs(x.v).max() for x in history) < 1.2  # 1.0 at the start
    closed = np.diff(history["0"].u, prepend=0.0) > 0.02
    assert closed.any() or (np.diff(history["1"].u) > 0.02).any()


# ---- energy grows only where the scheme does ---------------------------------------------------


class Relative:
    """What `newton_chains.energy` reads of a Result."""

    def __init__(self, history):
        self.subdomains = list(history)
        self.displacement_jump = history.displacement_jump


@pytest.mark.gate
@pytest.mark.parametrize(
    ("schedule", "rho"),
    [("gc, s = 1", 0.0), *((x, 0.5) for x in SCHEDULES if "macro" not in x)],
)
def test_the_stiff_cubic_chain_keeps_its_energy_with_small_rho(schedule, rho):
    subdomains, L = newton_chains.stiff_chain(rho=rho, **SCHEDULES[schedule][1])
    history = run_of(subdomains, L, 10.0 / newton_chains.OMEGA, 80, schedule, tol=1e-10)
    E = newton_chains.energy(Relative(history))
    assert E.max() < 1.5  # docs/method.md: 1.40 and 1.43 for gc, s = 1; 1 elsewhere


@pytest.mark.gate
def test_it_grows_with_large_rho_since_the_uncoupled_scheme_does():
    subdomains, L = newton_chains.stiff_chain(rho=0.9)
    history = run_of(subdomains, L, 10.0 / newton_chains.OMEGA, 250, "gc, s = 1", tol=1e-10)
    # after 262 steps the run of the uncut chain ends in an InstabilityError
    assert newton_chains.energy(Relative(history)).max() > 10.0  # docs/method.md: 3850 in 600 steps
    whole = uncoupled(0.9)
    assert whole.max() > 10.0 and uncoupled(0.5).max() < 1.5


def uncoupled(rho):
    """Energy of the uncut chain of nine masses, relative to that at t = 0."""
    n = 2 * newton_chains.N - 1
    pairs = [(i, i - 1) for i in range(n)]
    spring = pm.CubicSpring(pairs, k=newton_chains.K, k3=newton_chains.K3)
    how = dict(scheme=pm.GeneralizedAlpha(rho), internal=spring, u0=newton_chains.U0)
    s = pm.Subdomain(np.ones(n), None, **how)
    dt = 10.0 / newton_chains.OMEGA
    history = pm.solve(s, dt=dt, t_end=250 * dt)
    d = np.diff(history.u, axis=1, prepend=0.0)
    strain = (0.5 * newton_chains.K * d**2 + 0.25 * newton_chains.K3 * d**4).sum(axis=1)
    E = 0.5 * (history.v**2).sum(axis=1) + strain
    return E / E[0]


# ---- a pendulum of stiff bars ------------------------------------------------------------------


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_a_pendulum_of_stiff_bars_in_every_schedule(schedule):
    # omega_axial h = 63 with one substep; errors of docs/method.md for s = 5 at t = 1:
    # 0.0043, 0.0036
    subdomains, L = pendulum(**SCHEDULES[schedule][1])
    history = run_of(subdomains, L, 0.01, 40, schedule)
    assert pendulum_error(Relative(history)) < 0.02
    for x in history:
        # a bar of 1e7 under 60 N at most: it keeps its length to 6e-6, 1e-4 while it vibrates
        position = x.u.reshape(len(x.t), -1, 2) + [[1.0, 0.0], [2.0, 0.0]][: x.u.shape[1] // 2]
        length = np.linalg.norm(np.diff(position, axis=1, prepend=0.0)[:, 0], axis=-1)
        assert abs(length - 1.0).max() < 1e-3


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_pendulum_of_trusses_is_that_of_the_reference(coupling):
    # the same two bars from `structures.truss`, whose elements are vectorized
    bars = [
        structures.truss([[0.0, 0.0], [1.0, 0.0]], [[0, 1]], EA=1e7, rhoA=1.0, mass="lumped"),
        structures.truss([[1.0, 0.0], [2.0, 0.0]], [[0, 1]], EA=1e7, rhoA=2.0, mass="lumped"),
    ]
    reduction, internal = held(bars[0], bars[0].dofs(0))
    subdomains, L = pendulum(ss=(1, 5), double=coupling == "pm")
    ours = []
    for s, force, name in zip(subdomains, (internal, bars[1].internal), "01"):
        how = dict(internal=force, force=s.force, substeps=s.substeps, double_step=s.double)
        ours.append(pm.Subdomain(s.M, None, scheme=pm.GeneralizedAlpha(0.5), name=name, **how))
    constraint = pm.Constraint(dict(zip(ours, L)))
    history = pm.Coupler(ours, constraint, dt=0.01, coupling=coupling).run(steps=10)
    theirs = coupler(subdomains, L, 0.01, coupling).run(steps=10)
    # tol 1e-8 of the motion, about 1, in each of 10 steps, of bars whose force is 1e7 times u
    assert abs(history["1"].u - theirs["1"].u).max() < 1e-6


# ---- hundreds of constraints -------------------------------------------------------------------


# above 512 the approximate inverse of "macro" learns in limited memory; H of the others has panels
ROWS = {"gc": 200, "pm": 200, "macro": 516}


def membrane(n, side, name, **options):
    """n rows of two cubic springs in a line, unit masses; the tie is at its end or beginning."""
    dofs = np.arange(2 * n).reshape(n, 2)
    free, tied = dofs[:, side], dofs[:, 1 - side]
    across = np.column_stack([free[:-1], free[1:]])
    pairs = np.concatenate([dofs, across, np.column_stack([free, np.full(n, -1)])])
    v0 = np.zeros(2 * n)
    v0[free] = np.sin(np.linspace(0.0, 7.0, n)) * (1.0 if side else -0.5)
    options |= dict(scheme=pm.GeneralizedAlpha(0.6), internal=pm.CubicSpring(pairs, k=40.0, k3=4e3))
    return pm.Subdomain(np.ones(2 * n), None, v0=v0, name=name, **options), tied


def membranes(n, coupling, ss=1, newton=None, threads=None):
    a, right = membrane(n, 0, "a", double_step=coupling == "pm")
    b, left = membrane(n, 1, "b", substeps=ss)
    newton = newton or pm.Newton()
    tie = pm.tie(a, right, b, left)
    return pm.Coupler([a, b], tie, dt=0.05, coupling=coupling, newton=newton, threads=threads)


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_hundreds_of_constraints_are_iterated(coupling):
    rows = ROWS[coupling]
    c = membranes(rows, coupling, ss=3, newton=pm.Newton(tol=1e-10))
    history = c.run(steps=2)
    a, b = history["a"], history["b"]
    assert len(history.multipliers[0]) == rows and a.iterations[1:].min() >= 1
    jump = a.v[:, 1::2] - b.v[::3, ::2]
    # rounding; under "macro" the tolerance, 10 times 1e-10 of the motion in energy
    assert abs(jump).max() < (1e-7 if coupling == "macro" else 1e-12)
    # dof by dof in equilibrium at the ends of the macro steps
    lams = history.multipliers[:: (len(history.multipliers) - 1) // 2]
    for x, side, s in ((a, 0, c.subdomains[0]), (b, 1, c.subdomains[1])):
        pairs = s.internal.springs[0].dofs
        for k, lam in ((1, lams[1]), (2, lams[2])):
            level = k * s.substeps
            padded = np.append(x.u[level], 0.0)
            d = padded[pairs[:, 0]] - padded[pairs[:, 1]]
            f = np.zeros(2 * rows + 1)
            np.add.at(f, pairs[:, 0], 40.0 * d + 4e3 * d**3)
            np.add.at(f, pairs[:, 1], -40.0 * d - 4e3 * d**3)
            residual = x.a[level] + f[:-1]
            residual[1 - side :: 2] -= -lam if side else lam
            assert abs(residual).max() < 1e-6  # forces are about 10; tol 1e-10 in energy


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["pm", "macro"])
def test_many_constraints_are_bitwise_the_same_for_all_threads_and_from_a_file(tmp_path, coupling):
    whole = membranes(ROWS[coupling], coupling, ss=2, threads=1).run(steps=2)["b"].u
    one, other = (membranes(ROWS[coupling], coupling, ss=2, threads=2) for _ in range(2))
    one.step(1)
    one.save(tmp_path / "state")
    other.load(tmp_path / "state")
    np.testing.assert_array_equal(other.run(steps=1)["b"].u, whole[2:])


@pytest.mark.gate
def test_a_chain_of_sparse_tangents_has_the_pattern_of_its_springs():
    # 20 000 dofs: neither a dense tangent nor a dense factor could be held
    n = 20_000
    B = sp.eye_array(n, format="csr") - sp.eye_array(n, k=-1, format="csr")

    def evaluate(t, u, v, q):
        d = B @ u
        return B.T @ (d + 1e4 * d**3), B.T @ sp.diags_array(1.0 + 3e4 * d**2) @ B

    v0 = np.sin(np.linspace(0.0, 40.0, n))
    s = pm.Subdomain(np.ones(n), None, scheme=pm.GeneralizedAlpha(0.5), internal=evaluate, v0=v0)
    history = pm.solve(s, dt=0.1, t_end=0.5)
    spring = pm.CubicSpring(np.column_stack([np.arange(n), np.arange(n) - 1]), k=1.0, k3=1e4)
    other = pm.Subdomain(np.ones(n), None, scheme=pm.GeneralizedAlpha(0.5), internal=spring, v0=v0)
    theirs = pm.solve(other, dt=0.1, t_end=0.5)
    np.testing.assert_array_equal(history.iterations, theirs.iterations)
    assert abs(history.u - theirs.u).max() < 1e-12  # rounding of motions below 1
