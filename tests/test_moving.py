"""Points that run along a structure: moving forces and oscillators against closed forms."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import solve_ivp

import pmalpha as pm
from pmalpha import structures

# A beam of 10 m on two supports, whose first period is 0.45 s, crossed in 2 s
LENGTH, EI, DENSITY, SPEED, WEIGHT = 10.0, 1e6, 50.0, 5.0, 1000.0
SUPPORTS = ["ux 0", "uy 0", "uy 1"]
EXACT = pm.GeneralizedAlpha(1.0)  # the trapezoidal rule


def beam(elements, **options):
    ends = [[0, 0], [LENGTH, 0]]
    return structures.beam_frame(
        ends, [[0, 1]], EA=1e9, EI=EI, rhoA=DENSITY, divisions=elements, **options
    )


def along(structure, speed=SPEED, **options):
    return structure.moving_point(structure.nodes_at(y=0.0), speed, **options)


def middle(structure):
    return f"uy {structure.nodes_at(x=LENGTH / 2)[0]}"


def frequencies(modes):
    return (np.arange(1, modes + 1) * np.pi / LENGTH) ** 2 * np.sqrt(EI / DENSITY)


def force_on_a_beam(t, modes=50):
    """Displacement of the middle under a force that begins to move there: Fryba, Vibration of
    Solids and Structures under Moving Loads, 1972, the series of section 1.1."""
    k, omega = np.arange(1, modes + 1)[:, None], frequencies(modes)[:, None]
    driven = k * np.pi * SPEED / LENGTH
    size = 2.0 * -WEIGHT / (DENSITY * LENGTH) / (omega**2 - driven**2)
    motion = np.sin(driven * t) - driven / omega * np.sin(omega * t)
    return np.sum(size * motion * np.sin(k * np.pi / 2.0), axis=0)


def relative(x, exact):
    return np.abs(x - exact).max() / np.abs(exact).max()


# ---- a moving force ------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [EXACT, pm.GeneralizedAlpha(0.8), pm.HHT(0.1), pm.Bathe()])
def test_a_moving_force_moves_a_beam_as_the_series_of_its_modes(scheme):
    structure = beam(16)
    substeps = 2 if isinstance(scheme, pm.Bathe) else 1
    load = pm.MovingLoad(along(structure), -WEIGHT)
    bridge = structure.subdomain(scheme=scheme, fixed=SUPPORTS, force=load, substeps=substeps)
    motion = pm.solve(bridge, dt=0.002, t_end=2.0)[middle(structure)]
    # 2.5e-4 to 5e-4 measured: modes above the tenth have no step of their own
    assert relative(motion.u, force_on_a_beam(motion.t)) < 1e-3
    assert relative(motion.u, force_on_a_beam(motion.t + 0.01)) > 1e-2


def test_an_explicit_beam_with_substeps_carries_a_moving_force():
    structure = beam(10, mass="lumped")
    load = pm.MovingLoad(along(structure), -WEIGHT)
    scheme = pm.GeneralizedAlpha(1.0, explicit=True)
    bridge = structure.subdomain(scheme=scheme, fixed=SUPPORTS, force=load, substeps=40)
    motion = pm.solve(bridge, dt=0.008, t_end=2.0)[middle(structure)]
    # the lumped mass of ten elements: 1 / 10^4 of its fourth power, and loads on its rotations
    assert relative(motion.u, force_on_a_beam(motion.t)) < 5e-3


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_a_moving_load_is_that_of_a_python_function_under_every_coupling(coupling):
    """In each substep, also of double steps."""

    def run(force):
        structure = beam(4)
        bridge = structure.subdomain(
            scheme=pm.GeneralizedAlpha(0.7), fixed=SUPPORTS, force=force, substeps=2, name="bridge"
        )
        pier = pm.Subdomain([500.0], [1e6], scheme=EXACT, substeps=6, name="pier")
        tie = pm.tie(bridge, [middle(structure)], pier, [0])
        return pm.Coupler([bridge, pier], tie, dt=0.0303, coupling=coupling).run(steps=70)

    point = along(beam(4))
    load = pm.MovingLoad(point, pm.SampledForce([-1.0, -3.0, 2.0], dt=0.9))
    size = np.interp
    function = run(lambda t: size(t, [0.0, 0.9, 1.8], [-1.0, -3.0, 2.0]) * point.weights(t))
    core = run(load)
    for name in ("bridge", "pier"):
        # sums of a few terms in another order, 420 substeps
        assert relative(core[name].u, function[name].u) < 1e-11


def test_off_its_path_a_load_is_zero_and_both_ends_belong_to_it():
    structure = beam(2)
    point = along(structure, 0.25, start=-1.0)
    load = pm.MovingLoad(point, 8.0)
    bridge = structure.subdomain(scheme=EXACT, fixed=["ux 0"], force=load)
    uy = [bridge.dof_names.index(f"uy {node}") for node in (0, 2, 1)]
    assert not bridge.force(3.999).any() and not bridge.force(44.001).any()
    assert bridge.force(4.0)[uy].tolist() == [8.0, 0.0, 0.0]
    assert bridge.force(24.0)[uy].tolist() == [0.0, 8.0, 0.0]
    assert bridge.force(44.0)[uy].tolist() == [0.0, 0.0, 8.0]
    assert point.is_on([3.999, 4.0, 44.0, 44.001]).tolist() == [False, True, True, False]
    assert point.position(8.0) == 1.0


@pytest.mark.parametrize("GA", [None, 4e5])
def test_a_standing_force_within_an_element_bends_the_nodes_as_beam_theory(GA):
    """w = P b x (L^2 - b^2 - x^2) / (6 L EI) + P b x / (L GA) up to the force at a = L - b: the
    shape functions of a beam are those of its homogeneous equation, so that nodes are exact."""
    structure = beam(5, GA=GA)
    a = 5.3
    load = pm.MovingLoad(along(structure, 0.0, start=a), WEIGHT)
    bridge = structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=load, name="bridge")
    coupler = pm.Coupler([bridge], dt=0.1)
    u = coupler.static()["bridge"]
    for x in (2.0, 4.0, 6.0, 8.0):
        b, y = (LENGTH - a, x) if x < a else (a, LENGTH - x)
        w = WEIGHT * b * y * (LENGTH**2 - b**2 - y**2) / (6.0 * LENGTH * EI)
        w += 0.0 if GA is None else WEIGHT * b * y / (LENGTH * GA)
        node = structure.nodes_at(x=x)[0]
        found = u[bridge.dof_names.index(f"uy {node}")]
        assert found == pytest.approx(w, rel=1e-9)  # of a matrix with the condition 1e6


@pytest.mark.parametrize("kind", ["quad", "quad8", "triangle6"])
def test_along_the_edge_of_a_mesh_forces_and_moments_of_the_load_are_kept(kind):
    corners, middles = [[0, 0], [2, 0], [2, 1], [0, 1]], [[1, 0], [2, 0.5], [1, 1], [0, 0.5]]
    points = np.array(corners + (middles if kind != "quad" else []), dtype=float)
    cells = {"quad": [range(4)], "quad8": [range(8)], "triangle6": [[0, 1, 2, 4, 5, 8]]}[kind]
    points = np.vstack([points, [[1, 0.5]]]) if kind == "triangle6" else points
    used = np.unique(np.array(cells))
    number = np.full(len(points), -1)
    number[used] = np.arange(used.size)
    mesh = {kind: number[np.array(cells)]}
    plate = structures.plate_on(points[used], mesh, E=1.0, nu=0.3, rho=1.0)
    nodes = plate.nodes_at(y=0.0)
    point = plate.moving_point(nodes[::-1] if nodes[0] else nodes, 0.5, direction={"uy": -2.0})
    N = point.weights(2.5)
    across = N[plate.dofs(np.arange(used.size), "uy")]
    assert across.sum() == pytest.approx(-2.0)
    assert across @ plate.points[:, 0] == pytest.approx(-2.0 * 1.25)
    if kind != "quad":  # quadratic shape functions keep x^2 too
        assert across @ plate.points[:, 0] ** 2 == pytest.approx(-2.0 * 1.25**2)


def test_a_path_begins_at_the_end_that_is_named_first_whatever_the_order_of_its_nodes():
    structure = beam(4)
    forward, backward = (
        structure.moving_point(nodes, 1.0) for nodes in ([0, 3, 4, 2, 1], [1, 4, 3, 2, 0])
    )
    assert np.flatnonzero(forward.weights(0.0)).tolist() == [1]
    assert np.flatnonzero(backward.weights(0.0)).tolist() == [4]
    assert forward.length == LENGTH


def test_a_size_in_time_is_that_of_its_samples():
    structure = beam(3)
    point = along(structure)
    samples = pm.SampledForce([0.0, -30.0, -10.0], dt=0.4)
    load = pm.MovingLoad(point, samples)
    bridge = structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=load)
    unit = structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=pm.MovingLoad(point, 1.0))
    for t in (0.0, 0.3, 0.4, 0.7, 1.5):
        assert np.allclose(bridge.force(t), samples(t)[0] * unit.force(t), rtol=1e-14, atol=0.0)


# ---- vehicles -----------------------------------------------------------------------------------


BODY, STIFFNESS, DAMPING = 200.0, 200.0 * (2.0 * np.pi * 2.0) ** 2, 500.0


def vehicle_on(structure, force=None, scheme=EXACT, damping=DAMPING, **options):
    """A mass with its weight that runs over the beam on a spring and a damper, which push."""
    bridge = structure.subdomain(scheme=scheme, fixed=SUPPORTS)
    M, K = (sp.block_diag([A, [[x]]], format="csr") for A, x in ((bridge.M, BODY), (bridge.K, 0.0)))
    point = along(structure, fixed=SUPPORTS)
    wheel = pm.Gap([(point, "body")], STIFFNESS, 0.0, c=damping) if force is None else force(bridge)
    u0 = np.append(np.zeros(bridge.n), -WEIGHT / STIFFNESS)
    return pm.Subdomain(
        M,
        K,
        scheme=scheme,
        restoring=wheel,
        force=np.append(np.zeros(bridge.n), -WEIGHT),
        u0=u0,
        dof_names=[*bridge.dof_names, "body"],
        **options,
    )


def oscillator_on_a_beam(times, modes=12):
    """Body and middle of the beam, of the equations of the modes, which an independent solver
    integrates."""
    k, omega = np.arange(1, modes + 1), frequencies(modes)
    shape = np.sqrt(2.0 / (DENSITY * LENGTH))

    def rate(t, y):
        q, dq, z, dz = y[:modes], y[modes:-2], y[-2], y[-1]
        phi = shape * np.sin(k * np.pi * SPEED * t / LENGTH)
        slope = shape * np.cos(k * np.pi * SPEED * t / LENGTH) * k * np.pi * SPEED / LENGTH
        f = STIFFNESS * (phi @ q - z) + DAMPING * (phi @ dq + slope @ q - dz)
        return np.concatenate([dq, -(omega**2) * q - f * phi, [dz, (f - WEIGHT) / BODY]])

    start = np.zeros(2 * modes + 2)
    start[-2] = -WEIGHT / STIFFNESS
    y = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-9, atol=1e-12).y
    return y[-2], shape * np.sin(k * np.pi / 2.0) @ y[:modes]


def tied_wheel(bridge):
    """A spring and a damper that pull too."""
    point = along(beam(12), fixed=SUPPORTS)
    return pm.CubicSpring([(point, "body")], STIFFNESS, 0.0, c=DAMPING)


@pytest.mark.parametrize("force", [None, tied_wheel])
def test_a_damped_oscillator_crosses_a_beam_as_the_equations_of_its_modes(force):
    structure = beam(12)
    motion = pm.solve(vehicle_on(structure, force), dt=0.001, t_end=2.0)
    body, bent = oscillator_on_a_beam(motion.t)
    # 2e-4 and 5e-4 measured: forces on modes above the tenth, and the square of the step
    assert relative(motion["body"].u, body) < 1e-3
    assert relative(motion[middle(structure)].u, bent) < 2e-3
    undamped = pm.solve(vehicle_on(structure, damping=0.0), dt=0.001, t_end=2.0)
    assert relative(undamped["body"].u, body) > 1e-2


def test_the_displacement_under_the_wheel_gives_the_force_of_its_spring():
    structure = beam(6)
    motion = pm.solve(vehicle_on(structure, damping=0.0), dt=0.01, t_end=2.2)
    under = along(structure, fixed=SUPPORTS).displacement(motion)
    on = motion.t <= 2.0 + 1e-9
    assert np.isnan(under[~on]).all()
    a = motion["body"].a[on]
    f = STIFFNESS * (under[on] - motion["body"].u[on])
    # springs are evaluated at the predictor, which differs by h^2 times the acceleration
    assert np.abs(BODY * a + WEIGHT - f).max() < 0.02 * WEIGHT


def test_what_drives_a_vehicle_is_external_work_and_no_energy_of_the_steps():
    """The balance is that of the linear structure: the trapezoidal rule adds nothing to it."""
    bridge = vehicle_on(beam(6), name="bridge")
    history = pm.Coupler([bridge], dt=0.005).run(2.2, energy=True)
    energy = history.energy
    assert np.abs(energy.balance).max() < 1e-9 * energy.external.max()
    assert np.abs(energy.dissipated).max() == 0.0 and energy.external.max() > 1.0


def python_wheel(bridge):
    """The same spring and damper as a function, of the weights of the point."""
    point = along(beam(6))
    free = [
        int(3 * int(name.split()[1]) + ("ux", "uy", "rz").index(name.split()[0]))
        for name in bridge.dof_names
    ]

    def wheel(t, u, v):
        r = np.zeros(len(u))
        if point.is_on(t):
            N, ahead, behind = (point.weights(t + d)[free] for d in (0.0, 1e-6, -1e-6))
            slope = (ahead - behind) / 2e-6
            d = N @ u[:-1] - u[-1]
            f = STIFFNESS * d + DAMPING * (N @ v[:-1] + slope @ u[:-1] - v[-1])
            f = f if d > 0.0 and f > 0.0 else 0.0
            r = f * np.append(N, -1.0)
        return r

    return wheel


@pytest.mark.parametrize(("coupling", "substeps"), [("gc", 1), ("gc", 4), ("pm", 4), ("macro", 4)])
def test_wheels_of_the_core_are_those_of_a_python_function_under_every_coupling(coupling, substeps):
    def run(force):
        bridge = vehicle_on(beam(6), force, name="bridge")
        pier = pm.Subdomain(
            [500.0], [1e6], scheme=pm.GeneralizedAlpha(0.8), substeps=substeps, name="pier"
        )
        tie = pm.tie(bridge, [middle(beam(6))], pier, [0])
        return pm.Coupler([bridge, pier], tie, dt=0.0101, coupling=coupling).run(steps=210)

    core, function = run(None), run(python_wheel)
    for name in ("bridge", "pier"):
        # the slope by differences: 1e-16 / 1e-6 of the shape functions
        assert relative(core[name].u, function[name].u) < 1e-8


def test_the_steps_of_piers_that_are_cut_off_do_not_change_what_a_vehicle_does():
    structure, at = beam(8), middle(beam(8))

    def run(substeps, dt):
        bridge = vehicle_on(structure, name="bridge")
        pier = pm.Subdomain([300.0], [4e5], scheme=EXACT, substeps=substeps, name="pier")
        tie = pm.tie(bridge, [at], pier, [0])
        return pm.Coupler([bridge, pier], tie, dt=dt, coupling="gc").run(2.0)["bridge"]

    fine, cut = run(1, 0.0005), run(5, 0.005)
    assert relative(cut["body"].u, fine["body"].u[::10]) < 5e-3
    assert relative(cut[at].u, fine[at].u[::10]) < 2e-2


def test_a_cut_bridge_carries_a_moving_load_as_the_whole_one():
    structure = beam(8)
    load = pm.MovingLoad(along(structure), -WEIGHT)
    whole = pm.solve(
        structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=load), dt=0.01, t_end=2.0
    )
    labels = structure.points[structure.elements["line"]].mean(axis=1)[:, 0] > 4.0
    cut = pm.cut(structure, labels.astype(int), scheme=EXACT, fixed=SUPPORTS, force=load)
    u = cut.gather(cut.coupler(dt=0.01, coupling="gc").run(2.0)).u
    assert (
        relative(
            u[:, structure.dofs(structure.nodes_at(x=5.0), "uy")[0]], whole[middle(structure)].u
        )
        < 1e-9
    )


def test_a_reduced_bridge_keeps_its_moving_load():
    structure = beam(8)
    load = pm.MovingLoad(along(structure), -WEIGHT)
    bridge = structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=load)
    small, basis = bridge.reduced([bridge.dof_names.index(middle(structure))], modes=10)
    whole, less = (pm.solve(s, dt=0.01, t_end=2.0) for s in (bridge, small))
    assert relative(basis.expand(less.u), whole.u) < 5e-3  # modes above the tenth


# ---- with everything else ------------------------------------------------------------------------


def crossing(**options):
    bridge = vehicle_on(beam(4), name="bridge")
    pier = pm.Subdomain([5.0], [1e5], scheme=EXACT, substeps=2, name="pier")
    tie = pm.tie(bridge, [middle(beam(4))], pier, [0])
    return pm.Coupler([bridge, pier], tie, dt=0.01, coupling="gc", **options)


def test_states_files_and_threads_of_a_crossing_are_bitwise_those_of_one_run(tmp_path):
    whole = crossing().run(1.0)["bridge"].u
    coupler = crossing(threads=2)
    coupler.run(0.5)
    coupler.save(tmp_path / "state.npz")
    state = coupler.snapshot()
    assert np.array_equal(coupler.run(1.0)["bridge"].u, whole[50:])
    coupler.restore(state)
    assert np.array_equal(coupler.run(1.0)["bridge"].u, whole[50:])
    other = crossing()
    other.load(tmp_path / "state.npz")
    assert np.array_equal(other.run(1.0)["bridge"].u, whole[50:])


def test_a_state_of_another_path_is_refused(tmp_path):
    def coupler(start):
        load = pm.MovingLoad(along(beam(4), start=start), -WEIGHT)
        return pm.Coupler(
            [beam(4).subdomain(scheme=EXACT, fixed=SUPPORTS, force=load, name="bridge")], dt=0.01
        )

    coupler(0.0).save(tmp_path / "state.npz")
    with pytest.raises(ValueError, match="force of 'bridge'"):
        coupler(0.5).load(tmp_path / "state.npz")


def test_cases_with_moving_loads_are_the_runs_alone():
    point = along(beam(4))
    bridge = beam(4).subdomain(scheme=EXACT, fixed=SUPPORTS, name="bridge")
    coupler = pm.Coupler([bridge], dt=0.01)
    cases = [{"force": {"bridge": pm.MovingLoad(point, x)}} for x in (-1.0, -3.0)]
    each = coupler.run_each(cases, 1.0)
    for case, history in zip(cases, each):
        coupler.reset(**case)
        assert np.array_equal(coupler.run(1.0)["bridge"].u, history["bridge"].u)


def behind_an_actuator(spring):
    return pm.rig.SimulatedActuator(spring, delay=0.0)


def mass_with(spring, **options):
    return pm.Subdomain([1.0], [1.0], scheme=EXACT, restoring=spring, **options)


WHEEL = along(beam(4), fixed=SUPPORTS)
SPRING = pm.CubicSpring([("body", WHEEL)], 1.0, 0.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: vehicle_on(beam(4), lambda _: behind_an_actuator(SPRING)), "end that moves"),
        (lambda: pm.Subdomain([1.0], None, scheme=EXACT, internal=SPRING), "end that moves"),
        (lambda: pm.DiscreteGradient(SPRING), "end that moves"),
        (lambda: crossing().static(), "static needs springs .* with an end that moves on"),
        (lambda: crossing().modes(2), "restoring_stiffness .* with an end that moves"),
        (lambda: crossing().growth(10), "linear"),
        (lambda: crossing().run(0.1, tolerance=1e-3), "tolerance"),
        (lambda: beam(4).moving_point([0, 1], 1.0), "no edge"),
        (lambda: beam(4).moving_point([0], 1.0), "two nodes"),
        (lambda: beam(4).moving_point([0, 2], np.nan), "speed"),
        (lambda: along(beam(4), direction="rz"), "direction"),
        (lambda: along(beam(4), direction=["uy"]), "direction"),
        (lambda: pm.MovingLoad([0, 1], 1.0), "MovingPoint"),
        (lambda: pm.MovingLoad(WHEEL, [1.0, 2.0]), "SampledForce"),
        (lambda: pm.MovingLoad(WHEEL, pm.SampledForce([1.0], dt=1.0, average=True)), "average"),
        (lambda: pm.CubicSpring((0, WHEEL), 1.0, 0.0), "pairs"),
        (lambda: pm.CubicSpring([(WHEEL, WHEEL)], 1.0, 0.0), "differ"),
        (lambda: mass_with(pm.CubicSpring([(0, WHEEL)], 1.0, 0.0)), "that are not fixed"),
        (lambda: mass_with(SPRING, dof_names=["body"]), "all dofs of its path"),
    ],
)
def test_what_does_not_go_with_a_moving_point_is_refused_by_name(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_a_vehicle_that_starts_off_its_path_is_told_of():
    structure = beam(4)
    point = structure.moving_point(structure.nodes_at(y=0.0), 1.0, start=-1.0, fixed=SUPPORTS)
    wheel = pm.CubicSpring([(point, "body")], 1.0, 0.0)
    with pytest.warns(pm.AccuracyWarning, match="start off their path, at -1 of its length"):
        pm.Coupler([vehicle_on(structure, lambda _: wheel)], dt=0.01)


def test_a_load_that_crosses_its_path_within_few_steps_is_told_of():
    structure = beam(4)
    point = structure.moving_point(structure.nodes_at(y=0.0), 10.0 * LENGTH)
    bridge = structure.subdomain(scheme=EXACT, fixed=SUPPORTS, force=pm.MovingLoad(point, 1.0))
    with pytest.warns(pm.AccuracyWarning, match="crosses its path in 2 steps of 0.05"):
        pm.solve(bridge, dt=0.05, t_end=0.1)


def test_a_point_of_another_mesh_is_refused():
    force = pm.MovingLoad(along(beam(8)), 1.0)
    with pytest.raises(ValueError, match="must be of the structure of its subdomain"):
        beam(4).subdomain(scheme=EXACT, fixed=SUPPORTS, force=force)
