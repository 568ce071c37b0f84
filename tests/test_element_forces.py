"""Forces of elements and supports: equilibrium, and closed forms of beams."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import structures

EPS = np.finfo(float).eps


def portal(divisions=3):
    """Two columns of 3 and a girder of 4, clamped at points 0 and 1."""
    points = [[0.0, 0.0], [4.0, 0.0], [0.0, 3.0], [4.0, 3.5]]
    return structures.beam_frame(
        points,
        [[0, 2], [1, 3], [2, 3]],
        EA=[50.0, 60.0, 70.0],
        EI=[3.0, 4.0, 5.0],
        rhoA=2.0,
        divisions=divisions,
        mass="lumped",
    )


def test_end_forces_of_all_elements_add_up_to_the_nodal_forces():
    frame = portal()
    u = np.random.default_rng(0).normal(size=frame.n)
    ends = (frame.element_forces() @ u).reshape(-1, 2, 3)
    lines = frame.elements["line"]
    along = frame.points[lines[:, 1]] - frame.points[lines[:, 0]]
    c, s = (along / np.linalg.norm(along, axis=1)[:, None]).T
    total = np.zeros((len(frame.points), 3))
    for end in range(2):
        N, V, m = ends[:, end].T
        np.add.at(total, lines[:, end], np.column_stack([c * N - s * V, s * N + c * V, m]))
    size = (abs(frame.element_forces()) @ np.abs(u)).max()
    # each node sums a few end forces of some ten terms
    np.testing.assert_allclose(total.ravel(), frame.K @ u, rtol=0.0, atol=100 * EPS * size)
    length = np.linalg.norm(along, axis=1)
    balance = ends[:, 0] + ends[:, 1]
    np.testing.assert_allclose(balance[:, :2], 0.0, atol=100 * EPS * size)
    np.testing.assert_allclose(balance[:, 2] + length * ends[:, 1, 1], 0.0, atol=100 * EPS * size)


def test_a_cantilever_has_the_forces_of_statics():
    """Length 2 along 3-4-5, a tip load P across and N along: shear P, moment P (2 - s), force N."""
    direction, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    beam = structures.beam_frame(
        [[1.0, -1.0], 2.0 * direction + [1.0, -1.0]], [[0, 1]],
        EA=7.0, EI=3.0, rhoA=1.0, divisions=4,
    )  # fmt: skip
    P, N = 0.3, 2.0
    fixed = pm.reduce(beam.M, beam.K, fixed=beam.dofs(0))
    f = np.zeros(beam.n)
    f[beam.dofs(1, ["ux", "uy"])] = P * across + N * direction
    u = fixed.expand(np.linalg.solve(fixed.K.toarray(), f[fixed.free]))
    ends = (beam.element_forces() @ u).reshape(4, 6)
    # rounding of a system of condition 1e4
    tolerance = 1e-11
    np.testing.assert_allclose(ends[:, 3], N, atol=tolerance)
    np.testing.assert_allclose(ends[:, 4], P, atol=tolerance)
    np.testing.assert_allclose(ends[:, 5], P * np.array([1.5, 1.0, 0.5, 0.0]), atol=tolerance)
    np.testing.assert_allclose(beam.base_shear(0) @ u, -f[beam.dofs(1, "ux")], atol=tolerance)
    np.testing.assert_allclose(beam.base_shear(0, "uy") @ u, -f[beam.dofs(1, "uy")], atol=tolerance)
    np.testing.assert_allclose(beam.base_shear(0, "rz") @ u, -2.0 * P, atol=tolerance)


def test_rods_and_chains_have_normal_forces():
    EA = np.array([2.0, 5.0, 3.0])
    bar = structures.rod(3, 1.5, EA=EA, rhoA=1.0)
    np.testing.assert_allclose(
        bar.element_forces() @ (0.2 * bar.points[:, 0]), 0.2 * EA, rtol=1e-14
    )
    chain = structures.chain(4, 1.0, [1.0, 2.0, 3.0], ground=(9.0, 8.0))
    assert np.array_equal(chain.element_forces() @ [0.0, 1.0, 0.0, 2.0], [1.0, -2.0, 6.0])


def test_the_base_shear_of_a_shaken_frame_balances_its_inertia():
    """Recorded in a coupled run: with lumped masses, the shear at the feet is sum m w."""
    frame = portal()
    feet = frame.dofs([0, 1])
    fixed = pm.reduce(frame.M, frame.K, fixed=feet)
    u0 = np.zeros(frame.n)
    top = frame.dofs(3, "ux")
    v0 = fixed.expand(np.random.default_rng(1).normal(size=fixed.free.size))
    tower = pm.Subdomain(
        fixed.M, fixed.K, scheme=pm.GeneralizedAlpha(0.8), u0=u0[fixed.free],
        v0=v0[fixed.free], name="tower",
    )  # fmt: skip
    damper = pm.Subdomain(
        [1.5], [0.0], scheme=pm.GeneralizedAlpha(0.8), substeps=3, v0=v0[top], name="damper"
    )
    coupler = pm.Coupler(
        [tower, damper], pm.tie(tower, fixed.place(top), damper, 0), dt=0.05, coupling="pm"
    )
    ux = np.zeros(frame.n)
    ux[frame.dofs(np.arange(len(frame.points)), "ux")] = 1.0
    mass = (frame.M @ ux)[fixed.free]
    W = frame.base_shear([0, 1])[:, fixed.free]
    outputs = {"tower": {"shear": W, "inertia": {"a": mass}}, "damper": {"inertia": {"a": [1.5]}}}
    history = coupler.run(steps=30, record={}, outputs=outputs)
    tower, damper = (history[name].outputs for name in ("tower", "damper"))
    inertia = tower["inertia"] + damper["inertia"][::3]
    # equilibrium holds to the rounding of products with K, of condition 1e4 here
    np.testing.assert_allclose(tower["shear"], inertia, atol=1e-11 * np.abs(inertia).max())
    assert np.abs(inertia).max() > 0.1


def test_other_structures_are_refused():
    wall = structures.plate(2, 2, 0.5, E=1.0, nu=0.2, rho=1.0, t=1.0)
    with pytest.raises(ValueError, match=r"needs elements 'line' .* got \['quad'\]"):
        wall.element_forces()
    chain = structures.chain(2, 1.0, 3.0)
    twice = {"line": np.array([[0, 1], [1, 0]])}
    parallel = structures.Structure(chain.M, chain.K, chain.points, twice, ("ux",))
    with pytest.raises(ValueError, match="one element at most between two nodes"):
        parallel.element_forces()
    with pytest.raises(ValueError, match=r"nodes must lie in 0..1, got 5"):
        chain.base_shear(5)
    with pytest.raises(ValueError, match="component must be of"):
        chain.base_shear(0, "rz")
