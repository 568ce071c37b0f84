"""Energy of internal forces: potentials, what histories dissipate, and the first time level."""

import numpy as np
import pytest
from agreement import assert_order

import pmalpha as pm
from pmalpha import structures

TRAPEZOIDAL, EXPLICIT = pm.Newmark(), pm.CentralDifference()


class Hardening:
    """k u + k3 u^3 on each dof, with its energy."""

    def __init__(self, k, k3):
        self.k, self.k3 = k, k3

    def __call__(self, t, u, v, q):
        return self.k * u + self.k3 * u**3, self.k + 3.0 * self.k3 * u**2

    def potential(self, u):
        return float(np.sum(0.5 * self.k * u**2 + 0.25 * self.k3 * u**4))


def pair(dt, schemes=(TRAPEZOIDAL, EXPLICIT), substeps=(1, 2), coupling="gc", threads=1):
    """Two masses tied at a dof, both with hardening springs, released from u = 1."""
    K = [[8.0, -8.0], [-8.0, 8.0]]
    a, b = (
        pm.Subdomain(
            [1.0, 0.5],
            K,
            scheme=scheme,
            substeps=ss,
            internal=Hardening(4.0, 10.0),
            u0=[1.0, 1.0],
            name=name,
        )
        for name, scheme, ss in zip("ab", schemes, substeps)
    )
    ties = pm.tie(a, [1], b, [1])
    return pm.Coupler([a, b], ties, dt=dt, coupling=coupling, threads=threads)


# ---- conservative forces --------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.5), EXPLICIT])
def test_the_balance_of_a_conservative_oscillator_is_of_order_two(scheme):
    errors = []
    for h in (0.02, 0.01):
        mass = pm.Subdomain([1.0], None, scheme=scheme, internal=Hardening(4.0, 10.0), u0=[1.0])
        energy = pm.Coupler([mass], dt=h).run(2.0, energy=True).energy
        errors.append(np.abs(energy.balance).max())
    assert_order(errors, 1.9, 2.1)


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_the_balance_of_two_conservative_subdomains_is_of_order_two(coupling):
    errors, dissipated = [], []
    damped = pm.GeneralizedAlpha(0.5)
    for h in (0.02, 0.01):
        coupler = pair(h, (damped, damped), (1, 1), coupling)
        assert coupler._session.members[0].double == (coupling == "pm")
        energy = coupler.run(2.0, energy=True).energy
        errors.append(np.abs(energy.balance).max())
        dissipated.append(np.abs(energy.dissipated).max())
    assert_order(errors, 1.9, 2.1)
    # the difference of the work by the trapezoidal rule and the change of the potential
    assert_order(dissipated, 1.9, 2.1)


@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_the_trapezoidal_rule_closes_the_balance_to_the_tolerance_of_the_iteration(coupling):
    """From the first step on: f at the first time level is that of this time level."""
    coupler = pair(0.02, (TRAPEZOIDAL, TRAPEZOIDAL), (1, 1), coupling)
    energy = coupler.run(2.0, energy=True).energy
    assert (
        np.abs(energy.dissipated).max() > 0.01
    )  # the work by (B2) is not the change of the potential
    # 100 steps with an energy of 10, iterated to 1e-8 of it before the last correction
    assert np.abs(energy.balance).max() < 1e-8


def test_the_strain_energy_contains_the_potential():
    coupler = pair(0.02)
    history = coupler.run(2.0, energy=True, every=5)
    for i, (x, s) in enumerate(zip(history.subdomains, ("a", "b"))):
        K = coupler._session.keys[i][1].K
        expected = [0.5 * u @ K @ u + Hardening(4.0, 10.0).potential(u) for u in x.u]
        np.testing.assert_allclose(history.energy.strain[:, i], expected, rtol=1e-13, err_msg=s)


def test_a_force_without_potential_counts_as_dissipated():
    class Plain(Hardening):
        potential = None

    both = []
    for force in (Hardening(4.0, 10.0), Plain(4.0, 10.0)):
        mass = pm.Subdomain([1.0], [3.0], scheme=TRAPEZOIDAL, internal=force, u0=[1.0])
        both.append(pm.Coupler([mass], dt=0.02).run(2.0, energy=True).energy)
    kept, counted = both
    assert np.ptp(kept.strain - counted.strain) > 1.0
    # the sum is the same up to rounding of energies of order 5
    np.testing.assert_allclose(
        kept.strain + kept.dissipated - kept.strain[0],
        counted.strain + counted.dissipated - counted.strain[0],
        atol=1e-13,
    )
    np.testing.assert_allclose(kept.balance, counted.balance, atol=1e-13)


def held(structure, fixed, **options):
    """A subdomain of the dofs that are not fixed."""
    reduction = pm.reduce(structure.M, structure.K, fixed=fixed)
    internal = [force.reduced(reduction.free) for force in structure.internal]
    return pm.Subdomain(reduction.M, None, internal=internal, scheme=TRAPEZOIDAL, **options)


@pytest.mark.gate
def test_the_elements_of_a_frame_and_of_a_cable_keep_their_energy():
    ends = [[0, 0], [2, 0]], [[0, 1]]
    beam = structures.corotational_frame(*ends, EA=1e3, EI=4.0, rhoA=1.0, divisions=4)
    cable = structures.truss(*ends, EA=50.0, rhoA=1.0, divisions=4, prestress=2.0, slack=True)
    for structure, fixed in ((beam, beam.dofs(0)), (cable, cable.dofs([0, 1]))):
        lost = []
        for h in (0.004, 0.002):
            v0 = np.random.default_rng(2).standard_normal(structure.n - np.size(fixed))
            s = held(structure, fixed, v0=v0)
            energy = pm.Coupler([s], dt=h).run(0.2, energy=True).energy
            lost.append(np.abs(energy.dissipated).max() / energy.kinetic[0, 0])
            assert np.abs(energy.balance).max() < 1e-8 * energy.kinetic[0, 0]  # as above
        # order two, where the cable goes slack a little less
        assert lost[0] < 0.08 and lost[1] < 0.35 * lost[0]


# ---- the first time level -------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["gc", "macro"])
def test_the_works_of_two_intervals_are_those_of_one(coupling):
    """The first force of an interval is that at its beginning, not that of its first substep."""
    whole = pair(0.05, coupling=coupling).run(1.0, energy=True).energy
    coupler = pair(0.05, coupling=coupling)
    coupler.run(0.5)
    rest = coupler.run(1.0, energy=True).energy
    for kind in ("dissipated", "interface", "strain"):
        x = getattr(whole, kind)[10:]
        # rounding of sums of 20 works of order 1
        expected = x if kind == "strain" else x - x[0]
        np.testing.assert_allclose(getattr(rest, kind), expected, atol=1e-13, err_msg=kind)


# ---- forces with a history ------------------------------------------------------------------


@pytest.mark.gate
def test_a_shear_test_of_a_plastic_square_dissipates_what_its_loop_encloses():
    E, nu, strength, amplitude = 200.0, 0.25, 0.3, 0.02
    mu = E / (2.0 * (1.0 + nu))
    square = structures.nonlinear_solid(
        1, 1, 1.0, structures.J2Plasticity(E, nu, strength), rho=1.0
    )
    top = square.dofs(square.nodes_at(y=1.0), "ux")

    def velocity(t):
        v = np.zeros(8)
        v[top] = amplitude * 2.0 * np.pi * np.cos(2.0 * np.pi * t)
        return v

    v0 = velocity(0.0)
    loss = []
    for steps in (100, 200):
        s = square.subdomain(scheme=TRAPEZOIDAL, v0=v0, name="square")
        tie = pm.Constraint({s: np.eye(8)}, velocity=velocity)
        energy = pm.Coupler([s], tie, dt=1.0 / steps).run(2.25, energy=True).energy
        cycles = energy.dissipated[:: steps // 4, 0]
        loss.append(cycles[9] - cycles[5])  # from one end of the loop to the same one
    # simple shear without hardening: a parallelogram, yield stress in shear strength / sqrt(3)
    yield_at = strength / np.sqrt(3.0)
    enclosed = 4.0 * yield_at * (amplitude - yield_at / mu)
    # the trapezoidal rule cuts the corners of the loop, within a step each
    assert abs(loss[1] - enclosed) < abs(loss[0] - enclosed) < 5e-3 * enclosed
    assert abs(loss[1] - enclosed) < 2e-3 * enclosed


# ---- nothing else changes -------------------------------------------------------------------


def test_a_file_and_every_have_the_same_energy(tmp_path):
    pytest.importorskip("h5py")
    whole = pair(0.02).run(1.0, energy=True).energy
    record = {"a": [0]}
    some = pair(0.02).run(1.0, energy=True, every=5, record=record).energy
    filed = pair(0.02).run(1.0, energy=True, record=record, record_to=tmp_path / "x.h5").energy
    for kind in ("kinetic", "strain", "dissipated", "balance"):
        assert np.array_equal(getattr(some, kind), getattr(whole, kind)[::5])
        assert np.array_equal(getattr(filed, kind), getattr(whole, kind))


def test_the_potential_is_evaluated_once_per_macro_step_and_only_for_the_energy():
    calls = []

    class Counting(Hardening):
        def potential(self, u):
            calls.append(u.copy())
            u[:] = np.nan  # a copy
            return super().potential(calls[-1])

    for energy, expected in ((False, 0), (True, 11)):
        mass = pm.Subdomain(
            [1.0], None, scheme=TRAPEZOIDAL, substeps=3, internal=Counting(4.0, 10.0), u0=[1.0]
        )
        history = pm.Coupler([mass], dt=0.1).run(1.0, energy=energy)
        assert len(calls) == expected
    np.testing.assert_array_equal(np.array(calls), history.subdomains[0].u[::3])


# ---- failures -------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [TRAPEZOIDAL, EXPLICIT])
def test_an_exception_of_a_potential_ends_the_run_at_the_last_macro_step(scheme):
    class Failing(Hardening):
        def potential(self, u):
            if abs(u[0]) < 0.5:
                raise ZeroDivisionError("no energy")
            return super().potential(u)

    mass = pm.Subdomain([1.0], None, scheme=scheme, internal=Failing(4.0, 10.0), u0=[1.0])
    coupler = pm.Coupler([mass], dt=0.05)
    with pytest.raises(ZeroDivisionError, match="no energy"):
        coupler.run(2.0, energy=True)
    steps = coupler.step_count
    assert 0 < steps < 20 and coupler.last_history.energy.t.size == steps + 1
    history = coupler.run(2.0)  # without the energy it continues
    other = pm.Coupler([mass], dt=0.05)
    other.step(steps)
    assert other.run(2.0).subdomains[0].u.tobytes() == history.subdomains[0].u.tobytes()


def test_a_potential_that_is_no_number_is_named():
    class Wrong(Hardening):
        def potential(self, u):
            return [1.0]

    mass = pm.Subdomain([1.0], None, scheme=TRAPEZOIDAL, internal=Wrong(4.0, 1.0), name="mass")
    with pytest.raises(TypeError, match="potential of internal of subdomain 'mass' must return a"):
        pm.Coupler([mass], dt=0.05).run(steps=1, energy=True)
