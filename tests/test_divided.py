"""Large subdomains: steps at once, one by one, with energies, by several threads, and with errors.

Bitwise the same in all of these.
"""

from functools import cache

import numpy as np
import pytest
from agreement import assert_same_levels

import pmalpha as pm

IMPLICIT = pm.GeneralizedAlpha(0.8)
DT, STEPS = 0.1, 8


@cache
def block_mesh(i):
    material = {"E": 100.0, "nu": 0.3, "rho": 1.0, "mass": "lumped"}
    return pm.structures.solid(7, 6, 6, 1.0, **material, origin=(7 * i, 0, 0))


def blocks(count=2, *, substeps=(1, 1), scale=1.0, force=None, coupling="pm", **options):
    """Blocks of hexahedra in a row, each with a factor of some hundred thousand entries."""
    meshes = [block_mesh(i) for i in range(count)]
    members = [
        mesh.subdomain(
            scheme=IMPLICIT,
            substeps=s,
            force=scale * np.sin(np.arange(mesh.n)) if force is None else force,
            u0=0.01 * mesh.points[:, [0]].repeat(3, axis=1).ravel(),  # the faces agree
        )
        for mesh, s in zip(meshes, substeps)
    ]
    points = {s: mesh.points for s, mesh in zip(members, meshes)}
    ties = pm.tie_coincident(points, components=3) if count > 1 else []
    return pm.Coupler(members, ties, dt=DT, coupling=coupling, **options)


@pytest.mark.parametrize(
    "substeps, coupling, threads",
    [((1,), "pm", 1), ((1, 1), "gc", 2), ((1, 2), "pm", 2), ((3, 1), "gc", 1)],
)
def test_steps_at_once_one_by_one_and_with_energies_are_bitwise_identical(
    substeps, coupling, threads
):
    options = {"substeps": substeps, "coupling": coupling, "threads": threads}
    at_once, other = (blocks(len(substeps), **options) for _ in range(2))
    at_once.step(STEPS)
    for _ in range(STEPS):
        other.step()
    assert_same_levels(at_once, other)
    other.reset()
    other.run(steps=STEPS, energy=True)
    assert_same_levels(at_once, other)


def large_block(**options):
    """A block with fronts that BLAS factors: one subdomain, which one thread advances."""
    mesh = pm.structures.solid(9, 9, 9, 1.0, E=100.0, nu=0.3, rho=1.0, mass="lumped")
    member = mesh.subdomain(scheme=IMPLICIT, force=np.sin(np.arange(mesh.n)))
    return pm.Coupler([member], dt=DT, **options)


@pytest.mark.gate
@pytest.mark.parametrize("threads", [2, 5])
def test_one_solid_is_advanced_by_one_thread_of_several(threads):
    alone, shared = large_block(threads=1), large_block(threads=threads)
    one_by_one = large_block(threads=threads)
    assert (alone.threads, shared.threads) == (1, 1)
    expected, found = alone.run(steps=STEPS), shared.run(steps=STEPS)
    for name in ("u", "v", "a"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(expected[0], name))
    for _ in range(STEPS):
        one_by_one.step()
    assert_same_levels(shared, one_by_one)
    shared.run(steps=3, energy=True)
    alone.run(steps=3, energy=True)
    assert_same_levels(shared, alone)


@pytest.mark.gate
def test_eight_cases_of_large_subdomains_are_bitwise_single_runs():
    coupler = blocks()
    forces = [k * np.cos(np.arange(1176.0)) for k in range(8)]
    cases = [{"force": {"subdomain 1": force}} for force in forces]
    for case, found in zip(cases, coupler.run_each(cases, steps=STEPS)):
        coupler.reset(**case)
        np.testing.assert_array_equal(found[1].u, coupler.run(steps=STEPS)[1].u)


class Broken(Exception):
    pass


@pytest.mark.gate
def test_an_error_in_a_load_leaves_the_last_macro_level():
    def load(t):
        if t > 0.45:
            raise Broken
        return np.sin(np.arange(1176.0))

    stopped, reached = blocks(force=load), blocks()
    with pytest.raises(Broken):
        stopped.step(STEPS)
    reached.step(stopped.step_count)
    assert stopped.step_count == 4
    assert_same_levels(stopped, reached)


@pytest.mark.gate
@pytest.mark.parametrize("broken, step", [((0, 1, 2), 3), ((1, 2), 4)])
def test_of_several_subdomains_that_overflow_the_first_is_named_in_either_order(broken, step):
    with pytest.warns(pm.ConstraintWarning):  # tied, the interface would overflow first
        coupler = pm.Coupler(
            blocks(3, substeps=(1, 1, 1)).subdomains, [], dt=DT, threads=1, coupling="pm"
        )
    n = coupler.subdomains[0].n
    samples = np.zeros(STEPS + 1)
    samples[step] = 1.7e308  # on masses of 1/8 at the corners
    force = pm.SampledForce(samples, DT, shape=np.ones(n))
    coupler.reset(force={f"subdomain {i}": force for i in broken})
    with pytest.raises(pm.InstabilityError) as caught:
        coupler.step(STEPS)
    assert caught.value.subdomain == f"subdomain {broken[0]}"


@pytest.mark.gate
def test_values_that_are_not_finite_leave_the_last_macro_level():
    stopped = blocks(scale=1e307)
    with pytest.raises(pm.InstabilityError):
        stopped.step(1000)
    reached = blocks(scale=1e307)
    for _ in range(stopped.step_count):
        reached.step()
    assert_same_levels(stopped, reached)
