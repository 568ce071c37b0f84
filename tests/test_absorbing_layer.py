"""Absorbing layers: their matrices, Lamb's problem, steps of their own, waves that come in."""

import lamb_problem as lamb
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures

DAMPED = pm.GeneralizedAlpha(0.8)


def box(nx=12, ny=6, h=0.1, **options):
    material = {"E": 2.5, "nu": 0.25, "rho": 1.0, "plane": "strain", "mass": "lumped"}
    return structures.plate(nx, ny, h, **(material | options))


def hill(structure, at=(0.5, 0.3), width=0.15):
    """Displacements of a bump within the mesh, (n,)."""
    x = (structure.points - at) / width
    return np.repeat(np.exp(-(x**2).sum(axis=1)), 2) * np.tile([1.0, 0.5], len(x))


def coupled(
    soil, layer, *, ratio=1, dt=0.02, coupling="gc", scheme=DAMPED, beyond=DAMPED, **options
):
    ground = soil.subdomain(scheme=scheme, substeps=ratio, name="soil", **options)
    edge = layer.subdomain(scheme=beyond)
    return pm.Coupler([ground, edge], [layer.tie(ground, edge)], dt=dt, coupling=coupling)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_layer_without_stretch_is_the_elements_of_the_soil(mass):
    soil = box(8, 3, mass=mass, t=0.7, E=np.linspace(1.0, 3.0, 24))
    layer = soil.absorbing_layer(soil.nodes_at(x=0.8), 4, reflection=1.0)
    E = np.vstack([np.linspace(1.0, 3.0, 24).reshape(8, 3), *4 * [np.linspace(1.0, 3.0, 24)[-3:]]])
    plate = box(12, 3, mass=mass, t=0.7, E=E)
    end = plate.dofs(plate.nodes_at(x=1.2))
    u0 = np.zeros(plate.n)
    u0[: soil.n] = hill(soil)
    u0[36 * 2 :] = 0.0  # displacements of the layer are 0 at the start
    soil_u0 = u0[: soil.n].copy()
    soil_u0[soil.dofs(soil.nodes_at(x=0.8))] = u0[soil.dofs(soil.nodes_at(x=0.8))] = 0.0
    whole = plate.subdomain(scheme=pm.Newmark(), u0=u0, fixed=end)
    expected = pm.solve(whole, dt=0.02, steps=200, every=1).u[:, : soil.n]
    coupler = coupled(soil, layer, scheme=pm.Newmark(), beyond=pm.Newmark(), u0=soil_u0)
    motion = coupler.run(steps=200, every=1)["soil"].u
    # rounding of two eliminations; a layer of another thickness is off by a tenth
    np.testing.assert_allclose(motion, expected, rtol=0.0, atol=1e-10)
    assert np.abs(motion[-1]).max() > 0.05


def rates_of(layer, fixed=()):
    """Eigenvalues of the motion of a layer alone, without those at 0, of stress without strain."""
    alone = layer.subdomain(scheme=DAMPED, fixed=fixed)
    M, C, K = (sp.csr_array(A).toarray() for A in (alone.M, alone.C, alone.K))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, C)]])
    rates = la.eigvals(A)
    return M, C, K, rates[np.abs(rates) > 1e-5 * np.abs(rates).max()]


@pytest.mark.gate
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_mass_is_positive_damping_takes_energy_and_no_motion_of_the_layer_grows(mass):
    soil = box(1, 1, nu=0.45, mass=mass)
    M, C, K, rates = rates_of(soil.absorbing_layer(lamb.edge(soil), 3))
    assert la.eigvalsh(M).min() > 0.0
    assert la.eigvalsh(C + C.T).min() > -1e-12  # the coupling of u and S is skew
    assert np.abs(C - C.T).max() > 0.01 and np.abs(K - K.T).max() > 0.01
    assert rates.real.max() < 0.0


@pytest.mark.parametrize("held", [False, True])
def test_a_layer_between_two_edges_is_warned_of_and_decays_with_a_stretch_across(held):
    soil = box(1, 4)
    side = soil.nodes_at(x=0.1)
    layers = [soil.absorbing_layer(side, 3, across=share) for share in (0.0, 0.25)]
    fixed = layers[0].mesh.dofs(layers[0].mesh.nodes_at(y=0.0)) if held else ()
    without, with_it = (rates_of(layer, fixed)[-1].real.max() for layer in layers)
    assert with_it < 0.0 and 0.1 < without
    ground = soil.subdomain(scheme=DAMPED, name="soil")
    with pytest.warns(pm.StabilityWarning, match="layer at x = 0.1 is between two edges"):
        layers[0].tie(ground, layers[0].subdomain(scheme=DAMPED, fixed=fixed))
    assert layers[1].tie(ground, layers[1].subdomain(scheme=DAMPED, fixed=fixed)).p == 10


def test_a_layer_has_the_mass_of_its_elements_and_of_the_units():
    soil = box(4, 3, rho=1.7, t=0.5)
    layer = soil.absorbing_layer(lamb.edge(soil), 3)
    area = 1.0 * 0.6 - 0.4 * 0.3
    moved = np.tile([1.0, 0.0], len(layer.points))
    assert moved @ layer.M[: moved.size, : moved.size] @ moved == pytest.approx(1.7 * 0.5 * area)
    # in other units of force and mass, with the speeds of waves as they are, a factor of all
    heavy = box(4, 3, rho=1.7e3, E=2.5e3, t=0.5)
    other = heavy.absorbing_layer(lamb.edge(heavy), 3)
    for name in "MCK":
        a, b = getattr(layer, name), getattr(other, name)
        assert abs(1e3 * a - b).max() <= 1e-12 * abs(b).max()


def test_a_layer_of_a_turned_mesh_is_that_layer_turned():
    """x for y: the frequencies and decay rates of a strip along y are those of one along x."""
    rates = []
    for soil in (box(3, 2, (0.1, 0.2)), box(2, 3, (0.2, 0.1))):
        turned = len(rates)
        end = soil.nodes_at(**{"xy"[turned]: 0.3})
        layer = soil.absorbing_layer(end, 3).subdomain(scheme=DAMPED)
        M, C, K = (A.toarray() for A in (layer.M, layer.C, layer.K))
        A = np.block([[0 * M, np.eye(len(M))], [-la.solve(M, K), -la.solve(M, C)]])
        powers = [np.trace(np.linalg.matrix_power(A, k)) for k in (1, 2, 3)]  # sums of the rates
        rates.append(powers)
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-9)


@pytest.mark.gate
def test_a_pulse_leaves_and_without_the_stretch_it_returns():
    soil = box(20, 10)
    layers = [soil.absorbing_layer(lamb.edge(soil), 8, reflection=R) for R in (1e-3, 1.0)]
    u0 = hill(soil, at=(1.0, 0.5), width=0.3)
    u0[soil.dofs(lamb.edge(soil))] = 0.0
    left, reflected = (
        np.abs(
            coupled(soil, layer, u0=u0, ratio=2, dt=0.04).run(6.0, every=10)["soil"].v[-5:]
        ).max()
        for layer in layers
    )
    # waves of six elements in a length, which the layer resolves badly: 0.06
    assert left < 0.1 * reflected


def test_a_layer_is_tied_to_the_subdomains_of_a_cut_and_held_where_the_soil_is_held():
    soil = box(6, 4)
    mirror = soil.dofs(soil.nodes_at(x=0.0), "ux")
    nodes = soil.nodes(lambda x, y: (y < 0.01) | (x > 0.59))
    layer = soil.absorbing_layer(nodes, 3)
    labels = np.where(soil.points[soil.elements["quad"]].mean(axis=1)[:, 0] < 0.3, "a", "b")
    u0 = hill(soil)
    u0[soil.dofs(nodes)] = u0[mirror] = 0.0
    below = layer.mesh.dofs(layer.mesh.nodes_at(x=0.0), "ux")
    edge = layer.subdomain(scheme=DAMPED, fixed=below)
    whole = soil.subdomain(scheme=DAMPED, fixed=mirror, u0=u0, name="soil")
    tie = layer.tie(whole, edge)
    # ux 0 is fixed in both
    assert tie.p == 2 * len(nodes) - 1
    uncut = pm.Coupler([whole, edge], [tie], dt=0.02, coupling="gc").run(2.0, every=1)["soil"]
    parts = pm.cut(soil, labels, scheme=DAMPED, fixed=mirror, u0=u0)
    ties = [*parts.constraints, layer.tie(parts.subdomains, edge)]
    cut = pm.Coupler([*parts.subdomains, edge], ties, dt=0.02, coupling="gc").run(2.0, every=1)
    for s in parts.subdomains:
        for name in (s.dof_names[0], s.dof_names[-1]):
            np.testing.assert_allclose(cut[s.name][name].u, uncut[name].u, rtol=0.0, atol=1e-11)
    # held in the soil alone: the row holds the layer
    free = layer.subdomain(scheme=DAMPED)
    held = pm.Coupler([whole, free], [layer.tie(whole, free)], dt=0.02, coupling="gc").run(
        2.0, every=1
    )
    i = layer.pairs[layer.pairs[:, 0] == 0, 1][0]
    assert (
        np.abs(held["layer"][f"ux {i}"].u).max() < 1e-12 < np.abs(held["layer"][f"uy {i}"].u).max()
    )


@pytest.mark.parametrize("wave", ["SV", "P"])
@pytest.mark.parametrize(
    ("mass", "scheme"),
    [("lumped", pm.CentralDifference()), ("consistent", DAMPED)],
)
@pytest.mark.parametrize("ratio", [1, 4])
def test_layered_ground_without_a_structure_moves_as_the_free_field_and_the_layer_rests(
    wave, mass, scheme, ratio
):
    E = np.full((8, 5), 2.5)
    E[:, 3:] = 1.0
    soil = box(8, 5, E=E, mass=mass)
    layer = soil.absorbing_layer(lamb.edge(soil), 4)
    pulse = np.exp(-(((0.02 * np.arange(200) - 1.2) / 0.25) ** 2))
    motion = layer.vertical_wave(pulse, 3.0, dt=0.02, scheme=scheme, step=0.02, wave=wave)
    velocity, force = layer.free_field(motion)
    ground = soil.subdomain(scheme=scheme, force=force, substeps=ratio, name="soil")
    edge = layer.subdomain(scheme=DAMPED)
    ties = [layer.tie(ground, edge, velocity=velocity)]
    run = pm.Coupler([ground, edge], ties, dt=0.02 * ratio, coupling="gc").run(2.88, every=1)
    expected = np.array([motion(t, soil.points)[1].ravel() for t in run["soil"].t])
    # the surface has about twice the velocity of the incident wave, the soil above is softer
    assert 2.0 < np.abs(expected).max() < 3.0
    # the column is a motion of the mesh and of its steps: rounding is left
    np.testing.assert_allclose(run["soil"].v, expected, rtol=0.0, atol=1e-10)
    assert np.abs(run["layer"].v).max() < 1e-10


def test_a_free_field_comes_in_through_the_subdomains_of_a_cut():
    soil = box(8, 5)
    layer = soil.absorbing_layer(lamb.edge(soil), 4)
    pulse = np.exp(-(((0.02 * np.arange(200) - 1.2) / 0.25) ** 2))
    scheme = pm.CentralDifference()
    motion = layer.vertical_wave(pulse, 3.0, dt=0.02, scheme=scheme, step=0.02)
    velocity, force = layer.free_field(motion)
    above = soil.points[soil.elements["quad"]].mean(axis=1)[:, 1] > 0.3
    parts = pm.cut(soil, np.where(above, "above", "below"), scheme=scheme, force=force)
    edge = layer.subdomain(scheme=DAMPED)
    ties = [*parts.constraints, layer.tie(parts.subdomains, edge, velocity=velocity)]
    coupler = pm.Coupler([*parts.subdomains, edge], ties, dt=0.02, coupling="gc")
    v = parts.gather(coupler.run(2.0, every=1)).v
    expected = np.array([motion(0.02 * i, soil.points)[1].ravel() for i in range(len(v))])
    np.testing.assert_allclose(v, expected, rtol=0.0, atol=1e-10)
    coupler.reset()
    with pytest.raises(ValueError, match="t must lie in 0..3, where the wave is known"):
        coupler.run(4.0)


def test_a_vertical_wave_is_that_of_the_continuum_with_small_elements():
    soil = box(4, 80, 0.025)
    layer = soil.absorbing_layer(lamb.edge(soil), 3)
    t = 0.01 * np.arange(600)
    pulse = np.exp(-(((t - 1.5) / 0.4) ** 2))
    for wave, c in (("SV", 1.0), ("P", lamb.C_P)):
        motion = layer.vertical_wave(pulse, 5.9, dt=0.01, scheme=pm.Newmark(), step=0.01, wave=wave)
        y = motion.levels - motion.levels[0]
        up, down = (
            np.array([np.interp(motion.t - way / c, t, pulse) for way in ways]).T
            for ways in (y, 2.0 * y[-1] - y)
        )
        # dispersion of 16 elements in the width 0.4 of the pulse; one wave alone is off by 1
        assert np.abs(motion.v - up - down).max() < 0.01


def test_what_a_free_field_gives_is_checked_when_it_is_called():
    soil = box(4, 3)
    layer = soil.absorbing_layer(lamb.edge(soil), 3)
    with pytest.raises(TypeError, match="motion must be a function of t and points, got 3"):
        layer.free_field(3)
    velocity, _ = layer.free_field(lambda t, points: (points, points))
    with pytest.raises(TypeError, match="motion must return u, v and w"):
        velocity(0.0)
    velocity, _ = layer.free_field(lambda t, points: (points, points[:, 0], points))
    with pytest.raises(ValueError, match=r"v of motion must have shape \(\d+, 2\), got \(\d+,\)"):
        velocity(0.5)
    scheme = pm.CentralDifference()
    wave = layer.vertical_wave([0.0, 1.0, 0.0], 1.0, dt=0.1, scheme=scheme, step=0.05)
    with pytest.raises(ValueError, match=r"t must lie in 0..1, where the wave is known, got 1.5"):
        wave(1.5, soil.points)
    with pytest.raises(ValueError, match="points must lie in y = -0.1..0.3, got 0..1"):
        wave(0.5, np.array([[0.0, 0.0], [0.0, 1.0]]))
    with pytest.raises(TypeError, match="dt must be given with samples that are no Record"):
        layer.vertical_wave([0.0, 1.0], 1.0, scheme=scheme, step=0.05)
    with pytest.raises(ValueError, match="wave must be 'SV' or 'P', got 'SH'"):
        layer.vertical_wave([0.0, 1.0], 1.0, dt=0.1, scheme=scheme, step=0.05, wave="SH")
    below = soil.absorbing_layer(soil.nodes_at(y=0.0), 3)
    with pytest.raises(ValueError, match="vertical_wave needs a layer at the lower side and one"):
        below.vertical_wave([0.0, 1.0], 1.0, dt=0.1, scheme=scheme, step=0.05)
    for E, message in (
        (
            np.repeat([[1.0, 2.0, 2.0]], 4, axis=0) * np.linspace(1, 2, 4)[:, None],
            "other levels or",
        ),
        (np.repeat([[1.0], [2.0], [2.0], [1.0]], 3, axis=1), "got a stiffness of"),
    ):
        varied = box(4, 3, E=E)
        tilted = varied.absorbing_layer(lamb.edge(varied), 3)
        with pytest.raises(ValueError, match=f"vertical_wave needs horizontal layers, .*{message}"):
            tilted.vertical_wave([0.0, 1.0], 1.0, dt=0.1, scheme=scheme, step=0.05)


def triangles():
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    return structures.plate_on(points, [[0, 1, 2], [0, 2, 3]], E=1.0, nu=0.3, rho=1.0)


def quadratic():
    s = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [1, 2], [0, 1]])
    return structures.plate_on(s, [list(range(8))], E=1.0, nu=0.3, rho=1.0)


@pytest.mark.parametrize(
    ("structure", "message"),
    [
        (triangles(), "needs four-node elements 'quad' at its sides, got 'triangle'"),
        (quadratic(), "needs four-node elements 'quad' at its sides, got 'quad8'"),
        (structures.solid(1, 1, 1, 1.0, E=1.0, nu=0.3, rho=1.0), "four-node elements, got solids"),
        (structures.rod(3, 1.0, EA=1.0, rhoA=1.0), "needs linear plates, got elements 'line'"),
    ],
)
def test_other_elements_are_refused_by_name_with_what_takes_them(structure, message):
    with pytest.raises(ValueError, match=message) as caught:
        structure.absorbing_layer(structure.nodes_at(x=structure.points[:, 0].max()))
    assert "graded_damping and absorbing take other elements" in str(caught.value)


def test_nodes_and_numbers_that_make_no_layer_are_refused_by_name():
    soil = box(4, 3)
    side = soil.nodes_at(x=0.4)
    with pytest.raises(ValueError, match=r"nodes must be all nodes of a side, got some of x = 0.4"):
        soil.absorbing_layer(side[:2])
    with pytest.raises(
        ValueError, match=r"sides parallel to the axes .*, got 1 other \d+ at \[0.2"
    ):
        soil.absorbing_layer([*side, soil.nodes_at(x=0.2, y=0.2)[0]])
    with pytest.raises(ValueError, match="elements must be .*3"):
        soil.absorbing_layer(side, 2)
    for value in (0.0, 2.0):
        with pytest.raises(ValueError, match="reflection must lie in"):
            soil.absorbing_layer(side, reflection=value)
    with pytest.raises(
        ValueError, match="at most 5 times the speed of shear .*, got 7.14: a layer"
    ):
        box(4, 3, nu=0.49).absorbing_layer(side)
    layer = soil.absorbing_layer(side, 3, across=0.25)
    with pytest.raises(ValueError, match="scheme of an absorbing layer must be implicit"):
        layer.subdomain(scheme=pm.CentralDifference())
    with pytest.raises(TypeError, match="C must not be given: an absorbing layer has its own"):
        layer.subdomain(scheme=DAMPED, C=np.eye(3))
    edge, ground = layer.subdomain(scheme=DAMPED), soil.subdomain(scheme=DAMPED, name="soil")
    with pytest.raises(TypeError, match="soil must be a Subdomain, got"):
        layer.tie(["soil"], edge)
    plain = pm.Subdomain(soil.M, soil.K, scheme=DAMPED)
    with pytest.raises(ValueError, match="soil must have dof_names"):
        layer.tie(plain, edge)
    other = pm.Subdomain([1.0], [1.0], scheme=DAMPED, dof_names=["a"])
    with pytest.raises(ValueError, match="soil and layer must have free dofs of the sides"):
        layer.tie(ground, other)
    with pytest.raises(TypeError, match="velocity must be the function of t that free_field"):
        layer.tie(ground, edge, velocity=np.zeros(8))


def test_a_mesh_with_slopes_inside_and_a_hill_has_layers_at_its_straight_sides():
    soil = box(4, 3)
    points = soil.points.copy()
    inside = soil.nodes_at(x=0.2, y=0.2)
    points[inside] += [0.02, 0.01]
    points[soil.nodes_at(x=0.2, y=0.3)] += [0.0, 0.05]
    ground = structures.plate_on(points, soil.elements["quad"], E=2.5, nu=0.25, rho=1.0)
    layer = ground.absorbing_layer(lamb.edge(ground), 3)
    assert len(layer.mesh.elements["quad"]) == 3 * (3 + 3 + 4) + 2 * 9
    np.testing.assert_allclose(layer.points[layer.pairs[:, 1]], points[layer.pairs[:, 0]])
    # the corner that a chamfer takes away
    chamfered = structures.plate_on(*cut_corner(), E=2.5, nu=0.25, rho=1.0)
    nodes = chamfered.nodes(lambda x, y: (x < 0.01) | (y < 0.01))
    with pytest.raises(ValueError, match="the sides x = 0 and y = 0 must meet at a node of both"):
        chamfered.absorbing_layer(nodes, 3)


def cut_corner():
    """A plate of 3 x 3 elements without the one at the origin."""
    whole = structures.plate(3, 3, 0.1, E=1.0, nu=0.3, rho=1.0)
    return structures.submesh(whole.points, whole.elements["quad"][1:])[:2]


def test_graded_damping_is_in_the_elements_at_the_side_and_goes_with_a_cut():
    soil = box(20, 4)
    side = soil.nodes_at(x=2.0)
    damped = soil.graded_damping(side, 5, 0.3, dashpots=False)
    per_column = damped.C.diagonal()[::2].reshape(21, 5).sum(axis=1)
    assert (per_column[:15] == 0.0).all() and (per_column[15:] > 0.0).all()
    # the sum of alpha_e h_e / c_p over the depth is ln(1 / R)
    alpha = np.log(1.0 / 0.3) * 2.0 * lamb.C_P / 0.5 * (np.arange(5) + 0.5) / 5.0
    assert damped.C.sum() / 2.0 == pytest.approx((alpha * 0.1 * 0.4).sum())
    u0 = hill(soil)
    both = soil.graded_damping(side, 5)
    assert (
        abs(both.C - soil.graded_damping(side, 5, dashpots=False).C - soil.absorbing(side).C).max()
        == 0.0
    )
    expected = pm.solve(both.subdomain(scheme=DAMPED, u0=u0), dt=0.02, t_end=1.0, every=1).u
    parts = pm.cut(both, np.repeat([0, 1], [64, 16]), scheme=DAMPED, u0=u0)
    cut = pm.Coupler(parts.subdomains, parts.constraints, dt=0.02, coupling="gc").run(1.0, every=1)
    np.testing.assert_allclose(parts.gather(cut).u, expected, rtol=0.0, atol=1e-11)


def test_graded_damping_takes_plates_and_solids_of_every_kind_and_refuses_the_rest():
    for structure in (triangles, quadratic):
        made = structure()
        with pytest.raises(ValueError, match="elements must leave some of the mesh"):
            made.graded_damping(made.nodes_at(x=made.points[:, 0].max()), 2)
    solid = structures.solid(3, 1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
    damped = solid.graded_damping(solid.nodes_at(x=3.0), 2)
    assert damped.C.diagonal()[:12].max() == 0.0 < damped.C.diagonal()[12:].min()
    with pytest.raises(ValueError, match=r"reflection must lie in \(0, 1\), got 1"):
        solid.graded_damping(solid.nodes_at(x=3.0), 1, 1.0)
    rod = structures.rod(3, 1.0, EA=1.0, rhoA=1.0)
    with pytest.raises(
        ValueError, match="graded_damping needs linear plates or solids, got .*line"
    ):
        rod.graded_damping(3, 1)


@pytest.mark.gate
def test_lambs_problem_has_an_error_below_one_per_cent_with_ten_elements():
    exact = lamb.reference()
    assert lamb.error(lamb.with_layer(10), exact)[0] < 0.01  # 0.0078
    assert lamb.error(lamb.with_layer(10, ratio=2), exact, 2)[0] < 0.016  # 0.0151
    # the receivers of the study that had 0.023 are not known; rms 0.027 in both
    assert lamb.error(lamb.with_layer(5), exact)[0] < 0.03
    assert lamb.error(lamb.with_layer(5), exact)[1] < 0.028
    # ten steps in a period are too few
    few = lamb.with_layer(10, ratio=4, coupling="gc")
    assert 0.03 < lamb.error(few, exact, 4)[0] < 0.1
    dashpots = lamb.soil()
    dashpots = dashpots.with_damping(dashpots.absorbing(lamb.edge(dashpots)).C)
    assert lamb.error(lamb.alone(dashpots, 398), exact)[0] > 0.5


@pytest.mark.gate
def test_graded_damping_of_twenty_elements_is_better_than_dashpots_at_their_end():
    exact = lamb.reference()
    soil = lamb.soil(beyond=2.0)
    graded = soil.graded_damping(lamb.edge(soil), 20)
    dashpots = soil.with_damping(soil.absorbing(lamb.edge(soil)).C)
    with_graded, with_dashpots = (
        lamb.error(lamb.alone(x, 398), exact)[1] for x in (graded, dashpots)
    )
    assert with_graded < 0.08 and with_graded < 0.6 * with_dashpots  # 0.077, 0.145


@pytest.mark.gate
def test_layered_ground_goes_on_in_the_layer():
    def stiffness(x, y):
        return np.where(y > -1.5, 0.36, 1.0)

    big, small = lamb.soil(beyond=17.5, stiffness=stiffness), lamb.soil(stiffness=stiffness)
    exact = lamb.alone(big, 398)
    errors = []
    for elements in (5, 10):
        layer = small.absorbing_layer(lamb.edge(small), elements)
        scheme = pm.CentralDifference()
        ground = small.subdomain(scheme=scheme, force=lamb.pulse(small), name="soil")
        edge = layer.subdomain(scheme=pm.Newmark())
        record = {"soil": lamb.dofs_at(small, lamb.RECEIVERS)}
        coupler = pm.Coupler(
            [ground, edge], [layer.tie(ground, edge)], dt=lamb.step_of(0.1), coupling="gc"
        )
        errors.append(lamb.error(coupler.run(steps=398, every=1, record=record)["soil"].u, exact))
    assert errors[0][1] < 0.03 and errors[1][1] < 0.015


@pytest.mark.gate
@pytest.mark.parametrize(
    ("coupling", "substeps", "nu"),
    [("macro", 5, 0.25), ("macro", 5, 0.45), ("gc", 10, 0.45), ("gc", 20, 0.25)],
)
def test_nothing_grows_in_four_thousand_macro_steps_within_the_rule(coupling, substeps, nu):
    soil = box(nu=nu)
    layer = soil.absorbing_layer(lamb.edge(soil), 5)
    scheme = pm.GeneralizedAlpha(0.8, explicit=True)
    step = 0.9 * pm.analysis.critical_step(soil.subdomain(scheme=scheme))
    u0 = hill(soil)
    u0[soil.dofs(lamb.edge(soil))] = 0.0
    coupler = coupled(
        soil, layer, ratio=substeps, dt=substeps * step, coupling=coupling, scheme=scheme, u0=u0
    )
    v = np.abs(coupler.run(steps=4000, every=1)["soil"].v).max(axis=1)
    assert v[3000:].max() < 0.01 * v[:1000].max()


@pytest.mark.gate
@pytest.mark.parametrize(
    ("scheme", "substeps"),
    [(pm.CentralDifference(), 10), (pm.GeneralizedAlpha(0.8, explicit=True), 20)],
)
def test_beyond_the_rule_the_coupler_warns(scheme, substeps):
    soil = box()
    layer = soil.absorbing_layer(lamb.edge(soil), 5)
    step = 0.9 * pm.analysis.critical_step(soil.subdomain(scheme=scheme))
    with pytest.warns(pm.StabilityWarning, match="macro"):
        coupled(soil, layer, ratio=substeps, dt=substeps * step, coupling="macro", scheme=scheme)


@pytest.mark.gate
def test_three_steps_agree_with_one_mesh_at_the_finest_step():
    """A footing 100 times as stiff as the soil, steps 1 : 2 : 24 of layer, soil and footing."""

    def stiffness(x, y):
        return np.where((abs(x) < 0.5) & (y > -0.5), 100.0, 1.0)

    places = [*lamb.RECEIVERS, (-0.5, 0.0), (0.5, 0.0)]
    big, small = lamb.soil(beyond=11.0, stiffness=stiffness), lamb.soil(stiffness=stiffness)
    model = big.subdomain(scheme=pm.CentralDifference(), force=lamb.pulse(big))
    record = {0: lamb.dofs_at(big, places)}
    exact = pm.solve(model, dt=0.1 / 24, steps=2880, every=24, record=record).u
    scheme = pm.GeneralizedAlpha(0.8, explicit=True)
    x, y = small.points[small.elements["quad"]].mean(axis=1).T
    labels = np.where(stiffness(x, y) > 1.0, "footing", "soil")
    parts = pm.cut(small, labels, scheme=scheme, force=lamb.pulse(small))
    steps = {"soil": 2, "footing": 24}
    made = {
        s.name: pm.Subdomain(
            s.M,
            s.K,
            scheme=scheme,
            substeps=steps[s.name],
            force=s.force,
            name=s.name,
            dof_names=s.dof_names,
        )
        for s in parts.subdomains
    }
    layer = small.absorbing_layer(lamb.edge(small), 10)
    edge = layer.subdomain(scheme=pm.Newmark())
    ties = [
        pm.Constraint({made[s.name]: L for s, L in c.matrices.items()}) for c in parts.constraints
    ]
    ties.append(layer.tie(made["soil"], edge))
    run = pm.Coupler([*made.values(), edge], ties, dt=0.1, coupling="macro").run(12.0, every=1)
    names = [small.dof_names[i] for i in lamb.dofs_at(small, places)]
    motion = np.array(
        [run["soil" if x in made["soil"].dof_names else "footing"][x].u for x in names]
    ).T
    assert lamb.error(motion[:, :10], exact[:, :10])[0] < 0.026  # 0.017
    assert lamb.error(motion[:, 10:], exact[:, 10:])[0] < 0.008  # 0.0036


@pytest.mark.gate
def test_waves_that_a_footing_scatters_under_a_vertical_wave_leave():
    """Against 60 plain elements in place of the layer, at 1 : 12."""

    def stiffness(x, y):
        return np.where((abs(x) < 0.5) & (y > -0.5), 100.0, 1.0)

    soil = structures.plate(
        40,
        20,
        0.1,
        nu=0.25,
        rho=1.0,
        plane="strain",
        mass="lumped",
        origin=(-2.0, -2.0),
        E=2.5
        * stiffness(
            *np.meshgrid(np.arange(-1.95, 2, 0.1), np.arange(-1.95, 0, 0.1), indexing="ij")
        ),
    )
    scheme, step, end = pm.CentralDifference(), 0.1 / 24, 8.0
    pulse = lamb.ricker(0.01 * np.arange(900) - 0.2)
    motions = []
    for elements, ratio in ((60, 1), (10, 12)):
        layer = soil.absorbing_layer(lamb.edge(soil), elements)
        wave = layer.vertical_wave(pulse, 8.5, dt=0.01, scheme=scheme, step=step)
        velocity, force = layer.free_field(wave)
        ground = soil.subdomain(scheme=scheme, substeps=ratio, force=force, name="soil")
        plain = elements == 60
        edge = (
            layer.mesh.subdomain(scheme=scheme, name="layer")
            if plain
            else layer.subdomain(scheme=pm.Newmark())
        )
        tie = layer.tie(ground, edge, velocity=velocity)
        coupler = pm.Coupler([ground, edge], [tie], dt=step * ratio, coupling="gc")
        places = [(0.0, 0.0), (0.5, 0.0), (1.8, 0.0), (0.0, -1.8)]
        record = {"soil": lamb.dofs_at(soil, places)}
        motions.append(coupler.run(end, every=12 // ratio, record=record)["soil"].u)
    assert lamb.error(motions[1], motions[0])[0] < 0.003
