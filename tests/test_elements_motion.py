"""Nonlinear elements in motion: against Runge-Kutta solutions and closed forms."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures

PAGE = Path(__file__).parent.parent / "docs" / "elements.md"
RUBBER = structures.NeoHookean(100.0, 0.3)


def by_runge_kutta(mass, force, load, u0, v0, times):
    """u (k, n) of M a + f(u) = F for a diagonal M, by DOP853."""
    n = len(u0)

    def rates(t, y):
        return np.append(y[n:], (load - force(y[:n])) / mass)

    start = np.append(u0, v0)
    span = (0.0, times[-1])
    found = scipy.integrate.solve_ivp(
        rates, span, start, method="DOP853", t_eval=times, rtol=1e-10, atol=1e-12
    )
    return found.y[:n].T


def strip(nx=4, origin=0.0, t=1.0):
    """nx by 1 quadrilaterals with edges 0.5."""
    return structures.nonlinear_solid(
        nx, 1, 0.5, RUBBER, rho=1.0, t=t, mass="lumped", origin=(origin, 0.0)
    )


def held(structure, fixed):
    """The reduction, and the internal forces of the free dofs."""
    reduction = pm.reduce(structure.M, structure.K, fixed=fixed)
    return reduction, [force.reduced(reduction.free) for force in structure.internal]


def bent_strip():
    """A cantilever loaded at its end by a force that bends it by its length over three."""
    whole = strip()
    reduction, internal = held(whole, whole.dofs(whole.nodes_at(x=0.0)))
    load = np.zeros(whole.n)
    load[whole.dofs(whole.nodes_at(x=2.0), "uy")] = 0.3
    return whole, reduction, internal, load


@cache
def exact_strip():
    """At t = 0, 1 and 2."""
    _, reduction, internal, load = bent_strip()
    rest = np.zeros(reduction.free.size)
    mass, force = reduction.M.diagonal(), internal[0].residual
    u = by_runge_kutta(mass, force, reduction.reduce_load(load), rest, rest, [0.0, 1.0, 2.0])
    return reduction.expand(u)


@pytest.mark.gate
@pytest.mark.parametrize(
    "scheme, steps",
    [(pm.Newmark(), 60), (pm.CentralDifference(), 100)],
)
def test_a_rubber_strip_that_bends_far_follows_its_equation_of_motion(scheme, steps):
    _, reduction, internal, load = bent_strip()
    exact = exact_strip()

    def error(steps):
        subdomain = pm.Subdomain(
            reduction.M, None, internal=internal, scheme=scheme, force=reduction.reduce_load(load)
        )
        u = reduction.expand(pm.solve(subdomain, dt=1.0 / steps, t_end=2.0).u)
        return np.abs(u[::steps] - exact).max()

    coarse, fine = error(steps), error(2 * steps)
    assert np.abs(exact).max() > 0.3  # large: its slope and its stretch count
    # order 2
    assert coarse < 0.01 and coarse / fine == pytest.approx(4.0, rel=0.1)


@pytest.mark.gate
@pytest.mark.parametrize("coupling, steps", [("pm", 50), ("gc", 30)])
def test_a_strip_cut_into_an_implicit_and_an_explicit_subdomain_moves_as_the_whole(coupling, steps):
    whole, _, _, load = bent_strip()
    exact = exact_strip()
    left, right = strip(2), strip(2, origin=1.0)
    reduction, internal = held(left, left.dofs(left.nodes_at(x=0.0)))
    force = np.zeros(right.n)
    force[right.dofs(right.nodes_at(x=2.0), "uy")] = 0.3

    def error(steps):
        a = pm.Subdomain(
            reduction.M, None, internal=internal, scheme=pm.GeneralizedAlpha(0.9), name="a"
        )
        b = right.subdomain(
            scheme=pm.GeneralizedAlpha(0.9, explicit=True), substeps=4, force=force, name="b"
        )
        face = left.dofs(left.nodes_at(x=1.0))
        tie = pm.tie(a, reduction.place(face), b, right.dofs(right.nodes_at(x=1.0)))
        history = pm.Coupler([a, b], tie, dt=1.0 / steps, coupling=coupling).run(2.0)
        ours = [reduction.expand(history["a"].u)[::steps], history["b"].u[:: 4 * steps]]
        shared = whole.dofs(whole.nodes(lambda x, y: x <= 1.0))
        theirs = [exact[:, shared], exact[:, shared[0] + shared[-1] - 3 :]]
        return max(np.abs(u - v).max() for u, v in zip(ours, theirs, strict=True))

    errors = [error(steps), error(2 * steps)]
    # with substeps the interface is of first order at worst (docs/couplings.md)
    assert errors[0] < 4e-3 and errors[0] > 1.9 * errors[1]


@pytest.mark.gate
def test_an_elastic_pendulum_turns_over_as_its_equation():
    # a mass on an elastic bar, thrown so that it turns over; gravity as a load
    EA, L, m, g = 400.0, 1.0, 2.0, 9.81
    bar = structures.truss([[0, 0], [0, -L]], [[0, 1]], EA=EA, rhoA=4.0, mass="lumped")
    reduction, internal = held(bar, bar.dofs(0))
    assert reduction.M.diagonal().tolist() == [m, m]  # half of the bar
    v0 = np.array([7.5, 0.0])  # above sqrt(5 g L) = 7

    def rates(t, y):
        x = np.array([y[0], y[1] - L])
        length = np.hypot(*x)
        return np.append(y[2:], -EA * (length - L) / (L * m) * x / length - [0.0, g])

    times = np.linspace(0.0, 2.0, 5)
    found = scipy.integrate.solve_ivp(
        rates, (0, 2), [0, 0, *v0], method="DOP853", t_eval=times, rtol=1e-11, atol=1e-12
    )
    exact = found.y[:2].T

    def error(steps):
        pendulum = pm.Subdomain(
            reduction.M, None, internal=internal, scheme=pm.Newmark(), force=[0.0, -m * g], v0=v0
        )
        return np.abs(pm.solve(pendulum, dt=0.5 / steps, t_end=2.0).u[::steps] - exact).max()

    coarse, fine = error(120), error(240)
    assert exact[:, 1].max() > 1.5  # it was above its support
    assert coarse < 4e-3 and coarse / fine == pytest.approx(4.0, rel=0.05)


@pytest.mark.gate
@pytest.mark.parametrize("scheme", [pm.Newmark(), pm.CentralDifference()])
def test_a_mass_rebounds_from_the_floor_after_half_a_period_of_its_penalty(scheme):
    m, k, fall = 2.0, 800.0, 1.5
    bar = structures.truss([[0, 0.3], [1, 0.3]], [[0, 1]], EA=1.0, rhoA=2 * m, mass="lumped")
    contact = structures.plane_contact(bar, [0, 1], point=[0, 0], normal=[0, 1], stiffness=k)
    v0 = np.tile([0.0, -fall], 2)
    falling = pm.Subdomain(bar.M, None, internal=contact, scheme=scheme, v0=v0)
    # free until 0.3 / 1.5 = 0.2, in contact for pi sqrt(m / k) = 0.157, then back
    history = pm.solve(falling, dt=1e-3, t_end=0.5)
    omega = np.sqrt(k / m)
    since = history.t - 0.2
    inside = -fall / omega * np.sin(omega * since)
    after = fall * (since - np.pi / omega)
    y = np.where(since < 0, -fall * since, np.where(omega * since < np.pi, inside, after)) - 0.3
    # (omega dt)^2 = 4e-4, over 12 for the period, times the depth 0.075 and pi / 2: 4e-6; then the
    # force begins and ends within a step, which adds 1e-3 of fall times dt, 1.5e-6, at each side
    np.testing.assert_allclose(history.u[:, 1], y, atol=2e-5)
    assert not history.u[:, [0, 2]].any()


def shear_layer(hardening):
    """One quadrilateral that only shears, and the spring that it is."""
    E, nu, strength = 200.0, 0.25, 1.5
    G = E / (2 * (1 + nu))
    steel = structures.J2Plasticity(E, nu, strength, kinematic=hardening)
    layer = structures.nonlinear_solid(1, 1, 1.0, steel, rho=4.0, mass="lumped")
    free = layer.dofs(layer.nodes_at(y=1.0), "ux")
    internal = layer.internal[0].reduced(free)
    spring = {"k": G / 2, "fy": strength / np.sqrt(3) / 2}
    return sp.csr_array(layer.M)[free][:, free], internal, spring | {"hardening": hardening, "G": G}


@pytest.mark.gate
def test_a_plastic_layer_in_shear_is_a_bilinear_spring():
    H = 30.0
    M, internal, law = shear_layer(H)
    # tau = G gamma to sigma_y / sqrt 3, then with the slope G H / (H + 3 G), and it moves along
    spring = pm.Bilinear([0], k=law["k"], fy=law["fy"], hardening=H / (H + 3 * law["G"]))
    record = pm.SampledForce(np.sin(np.linspace(0.0, 30.0, 301)), dt=0.1, shape=[[0.6], [0.6]])
    one = pm.SampledForce(np.sin(np.linspace(0.0, 30.0, 301)), dt=0.1, shape=[[0.6]])
    layer = pm.Subdomain(M, None, internal=internal, scheme=pm.Newmark(), force=record)
    mass = M.diagonal()[:1]
    alone = pm.Subdomain(mass, None, internal=spring, scheme=pm.Newmark(), force=one)
    ours, theirs = (pm.solve(s, dt=0.05, t_end=30.0) for s in (layer, alone))
    largest = np.abs(theirs.u).max()
    assert largest > 5 * law["fy"] / law["k"]  # yields in both directions
    assert theirs.u.min() < -2 * law["fy"] / law["k"]
    # rounding: both laws are linear in pieces, on which Newton's method is exact
    np.testing.assert_allclose(ours.u, theirs.u[:, [0, 0]], atol=1e-12 * largest)


def test_the_block_of_the_page_lies_on_its_floor():
    names = {}
    program = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0]
    exec(compile(program, PAGE.name, "exec"), names)
    block, supported, contact = names["block"], names["supported"], names["internal"][1]
    # the weight of a block of 0.08 x 0.04 x 0.04, of which half an element is held
    assert -names["subdomain"].force.sum() == pytest.approx(9.81 * 1100 * 0.07 * 0.04**2)
    u = pm.solve(names["subdomain"], dt=1e-3, t_end=0.01).u
    down = u[:, supported.place(block.dofs(block.nodes_at(x=0.08, z=0.0), "uz"))]
    # it is held at one end and sinks at the other, where the floor has to carry some of it
    carried = -contact.residual(u[-1])[
        supported.place(block.dofs(block.nodes(lambda x, y, z: x > 0), "uz"))
    ]
    assert down[-1].max() < 0.0 < carried.sum() < 2 * 9.81 * 1100 * 0.07 * 0.04**2
