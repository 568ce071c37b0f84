"""Runs with contact: refusals, records, state, threads, and problems with published figures."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from agreement import assert_close
from contact_problems import SPEED, bar, critical
from scipy.optimize import brentq

import pmalpha as pm


def pounding(h, scheme=None, **options):
    """Two masses on springs under a ground motion, with a clearance."""
    chosen = {"scheme": scheme or pm.Newmark()}
    a = pm.Subdomain(
        [1.0], [40.0], v0=[1.0], force=lambda t: [-3.0 * np.sin(4 * t)], name="a", **chosen
    )
    b = pm.Subdomain(
        [1.5], [20.0], v0=[-0.5], force=lambda t: [-4.5 * np.sin(4 * t)], name="b", **chosen
    )
    joint = pm.contact(a, [0], b, [0], gap=0.02, restitution=0.65, name="joint")
    return pm.Coupler([a, b], joint, dt=h, coupling="gc", **options), joint


def plate(**options):
    """A rigid plate, three dofs (heave and two tilts), on 16 points: 13 of them are redundant."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 4), np.linspace(-1.0, 1.0, 4))
    N = np.column_stack([np.ones(16), x.ravel(), y.ravel()])
    M = [2.0, 0.7, 0.5]
    s = pm.Subdomain(M, np.zeros(3), scheme=pm.Newmark(), force=[-20.0, 3.0, -2.0], name="plate")
    return pm.Coupler([s], pm.Contact({s: N}, name="ground"), dt=0.01, **options), N


# ---- 9, 10 ---------------------------------------------------------------------------------------


def exact_pounding(times):
    """u of mass a, and the number of impacts: closed forms between impacts, found by bisection."""
    m, k = np.array([1.0, 1.5]), np.array([40.0, 20.0])
    omega = np.sqrt(k / m)
    forced = -3.0 / (omega**2 - 16.0)  # u'' + omega^2 u = -3 sin 4 t

    def motion(start, t):
        t0, u0, v0 = start
        A = u0 - forced * np.sin(4.0 * t0)
        B = (v0 - 4.0 * forced * np.cos(4.0 * t0)) / omega
        c, s = np.cos(omega * (t - t0)), np.sin(omega * (t - t0))
        u = A * c + B * s + forced * np.sin(4.0 * t)
        return u, omega * (B * c - A * s) + 4.0 * forced * np.cos(4.0 * t)

    def gap(start, t):
        u = motion(start, t)[0]
        return 0.02 + u[1] - u[0]

    start, u, impacts = (0.0, np.zeros(2), np.array([1.0, -0.5])), [], 0
    for last, t in zip([0.0, *times], times):
        while gap(start, t) < 0.0:
            instant = brentq(lambda x, of=start: gap(of, x), max(last, start[0] + 1e-9), t)
            at, v = motion(start, instant)
            impulse = 1.65 * (v[1] - v[0]) / np.sum(1.0 / m)
            start, impacts = (instant, at, v + impulse * np.array([1.0, -1.0]) / m), impacts + 1
        u.append(motion(start, t)[0][0])
    return np.array(u), impacts


@pytest.mark.gate
def test_two_masses_pound_as_by_their_exact_motion():
    times = 4e-3 * np.arange(1, 1001)
    exact, impacts = exact_pounding(times)
    assert impacts == 7

    def error(h):
        coupler, joint = pounding(h)
        history = coupler.run(4.0)
        closed = np.flatnonzero(history.contacts[joint].closed[:, 0])
        assert sum(b - a > 1 for a, b in pairwise([-9, *closed])) == impacts
        return np.abs(history["a"].u[:: round(4e-3 / h), 0][1:] - exact).max()

    errors = [error(h) for h in (4e-3, 2.5e-4)]
    assert errors[0] < 8e-3 and errors[1] < 6e-4
    assert errors[1] < errors[0] / 8.0  # of order one: the instants of impacts


def test_a_plate_on_redundant_contacts_is_held_by_their_sums():
    coupler, N = plate()
    force = coupler.run(1.0).contacts["ground"].force[-1]
    np.testing.assert_allclose(N.T @ force, [20.0, -3.0, 2.0], rtol=1e-12)


# its weight makes K indefinite, as it has to
@pytest.mark.filterwarnings("ignore:K of subdomain 'block':pmalpha.StabilityWarning")
def test_a_rocking_block_loses_what_housner_says():
    """Rows are linear, so rotations are small: a quarter period of 0.4951 s; an impact keeps
    (I0 - 2 m b^2) / I0 = 0.9423 of the rate."""
    b, H, theta0 = 0.2, 1.0, 0.1  # half width, half height, and half of the angle b / H
    m = 1.0
    inertia = m * (b**2 + H**2) / 3.0
    g = 9.81
    # heave and sway of the centre, rotation; the weight acts at the lever (b - H theta)
    K = np.diag([0.0, 0.0, -m * g * H])
    corners = np.array([[1.0, 0.0, b], [1.0, 0.0, -b]])
    base = np.array([[0.0, 1.0, H], [0.0, 1.0, H]])
    lift = b * theta0
    block = pm.Subdomain(
        [m, m, inertia],
        K,
        scheme=pm.Newmark(),
        symmetric=True,
        force=[-m * g, 0.0, 0.0],
        u0=[lift, -H * theta0, theta0],
        name="block",
    )
    floor = pm.Contact({block: corners}, tangents=[{block: base}], friction=10.0, name="floor")

    def rates(h):
        """When it stands upright, and the rate of the first level after the impact over that of the
        last before."""
        history = pm.Coupler([block], floor, dt=h).run(steps=round(1.2 / h))
        theta, rate = history["block"].u[:, 2], history["block"].v[:, 2]
        k = int(np.flatnonzero(theta <= 0.0)[0])
        rest = h * theta[k] / (theta[k - 1] - theta[k])
        return history["block"].t[k] + rest, rate[k] / rate[k - 1]

    about = inertia + m * (b**2 + H**2)
    p = np.sqrt(m * g * H / about)
    quarter = np.arccosh(1.0 / (1.0 - theta0 * H / b)) / p
    expected = (about - 2.0 * m * b**2) / about
    for h, share in ((2e-3, 1e-2), (5e-4, 2.5e-3)):
        t, ratio = rates(h)
        assert abs(t - quarter) < 1e-4
        assert abs(ratio / expected - 1.0) < share


def test_any_number_of_threads_is_bitwise_the_same():
    M, K = bar(30)
    h = 0.9 * critical(30)
    a = pm.Subdomain(M, K, scheme=pm.Newmark(), v0=np.full(31, SPEED), name="a")
    b = pm.Subdomain(M, K, scheme=pm.CentralDifference(), name="b")

    def run(threads):
        joint = pm.contact(a, [30], b, [0], gap=0.1)
        coupler = pm.Coupler([a, b], joint, dt=h, coupling="gc", threads=threads)
        return coupler.run(steps=100)

    first, second = run(1), run(2)
    assert first.contacts[0].closed.any()
    assert np.array_equal(first["b"].u, second["b"].u)
    assert np.array_equal(first.contact_impulses, second.contact_impulses)


@pytest.mark.parametrize("coupling", ["gc", "pm"])
def test_without_a_closed_row_a_run_is_bitwise_the_one_without_contacts(coupling):
    M, K = bar(20)
    h = 0.5 * critical(20)
    fine = {"scheme": pm.CentralDifference(), "substeps": 4}
    a = pm.Subdomain(M, K, scheme=pm.GeneralizedAlpha(0.5), v0=np.full(21, 0.1), name="a")
    b = pm.Subdomain(M, K, v0=np.full(21, 0.1), name="b", **fine)
    ties = pm.tie(a, [20], b, [0])
    far = pm.contact(b, [20], gap=1e3, sign=-1)
    runs = [
        pm.Coupler([a, b], c, dt=4 * h, coupling=coupling).run(steps=40)
        for c in (ties, [ties, far])
    ]
    for name in ("a", "b"):
        assert np.array_equal(runs[0][name].u, runs[1][name].u)
    assert not runs[1].contacts[0].closed.any()


def test_a_thousand_rows_take_few_turns():
    rng = np.random.default_rng(1)
    n = 1000
    A = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1])
    s = pm.Subdomain(
        np.ones(n), sp.csr_array(A), scheme=pm.CentralDifference(), force=rng.normal(size=n) - 0.5
    )
    coupler = pm.Coupler([s], pm.contact(s, np.arange(n)), dt=0.5)
    coupler.step(1)
    assert coupler._session.core.contact_turns() <= 6
    coupler.step(4)
    assert coupler._session.core.contact_turns() <= 3


# ---- records and state ---------------------------------------------------------------------------


def test_impulses_are_summed_where_levels_are_left_out():
    every = pounding(4e-3)[0].run(4.0)
    some = pounding(4e-3)[0].run(4.0, every=50)
    np.testing.assert_allclose(
        some.contacts[0].impulse.sum(), every.contacts[0].impulse.sum(), rtol=1e-13
    )
    assert some.contacts[0].t.size == 21
    np.testing.assert_array_equal(some.contacts[0].gap, every.contacts[0].gap[::50])


def test_contacts_are_found_by_object_name_and_index_also_from_files(tmp_path):
    coupler, joint = pounding(4e-3)
    history = coupler.run(2.0, energy=True)
    assert history.contacts[joint] is not history.contacts  # a record of its own
    for path in (tmp_path / "run.npz", tmp_path / "run.h5"):
        history.save(path)
        again = pm.History.load(path)
        for key in ("joint", 0):
            assert np.array_equal(again.contacts[key].impulse, history.contacts[joint].impulse)
        assert np.array_equal(again.energy.contact, history.energy.contact)
    with pytest.raises(KeyError, match="no contact 'wall'; there are 'joint'"):
        history.contacts["wall"]
    filed = pounding(4e-3)[0].run(2.0, record_to=tmp_path / "long.h5")
    assert np.array_equal(filed.contacts["joint"].impulse, history.contacts["joint"].impulse)


def test_a_run_goes_on_bitwise_from_a_checkpoint_a_snapshot_and_another_run(tmp_path):
    whole = pounding(4e-3)[0].run(4.0)
    coupler, _ = pounding(4e-3)
    first = coupler.run(1.6)
    coupler.save(tmp_path / "state.npz")
    kept = coupler.snapshot()
    second = coupler.run(4.0)
    joined = pm.History.join([first, second])
    assert np.array_equal(joined["a"].u, whole["a"].u)
    assert np.array_equal(joined.contact_impulses, whole.contact_impulses)
    coupler.restore(kept)
    assert np.array_equal(coupler.run(4.0)["b"].u, second["b"].u)
    other, _ = pounding(4e-3)
    other.load(tmp_path / "state.npz")
    assert np.array_equal(other.run(4.0)["b"].u, second["b"].u)
    coupler.reset()
    assert np.array_equal(coupler.run(4.0)["b"].u, whole["b"].u)


def test_cases_run_each_by_itself():
    coupler, _ = pounding(4e-3)
    cases = [{"v0": {"a": [v]}} for v in (1.0, 1.1, 1.2, 1.3)]
    histories = coupler.run_each(cases, 1.0)
    coupler.reset(v0={"a": [1.2]})
    assert np.array_equal(coupler.run(1.0)["a"].u, histories[2]["a"].u)


def test_steps_change_while_a_ball_bounces():
    s = pm.Subdomain([1.0], [0.0], scheme=pm.Newmark(), force=[-10.0], u0=[1.0], name="ball")
    coupler = pm.Coupler([s], pm.contact(s, 0, restitution=1.0), dt=2e-3)
    coupler.run(1.0)
    coupler.change_steps(dt=1e-3)
    history = coupler.run(3.0)
    assert abs(history["ball"].u.max() - 1.0) < 1e-11


def test_an_obstacle_that_moves_pushes():
    """A plate that accelerates: what stands on it weighs m (g + a)."""
    s = pm.Subdomain([2.0], [0.0], scheme=pm.Newmark(), force=[-20.0], name="box")
    for motion in (lambda t: 1.5 * t**2, (lambda t: 1.5 * t**2, lambda t: 3.0 * t)):
        lift = pm.contact(s, 0, motion=motion)
        history = pm.Coupler([s], lift, dt=0.01).run(1.0)
        force, t = history.contacts[0].force[1:], history.macro_times[1:]
        assert_close(force, 26.0, 1e-9, "contact force", size=26.0, times=t, column="contact")
        assert_close(history["box"].v[-1:], 3.0, 1e-9, "last velocity of the box", size=3.0)


def test_impulses_with_friction_do_not_depend_on_what_was_solved_before():
    """Rows that follow from each other: many impulses solve, and which of them is found depends on
    the last ones alone, also after an iteration in which no row pushes."""

    def made():
        a = pm.Subdomain([2.602], [4.869], scheme=pm.GeneralizedAlpha(0.8), name="a")
        b = pm.Subdomain([2.466], [1.874], scheme=pm.GeneralizedAlpha(0.8), name="b")
        rub = pm.contact(a, [0], b, [0], gap=0.01, friction=0.3, tangents=[([0], [0])],
                         friction_static=0.5, name="rub")  # fmt: skip
        pushed = pm.SampledForce([[0.0], [0.4], [-0.2], [0.1]], 0.06)
        held = pm.Constraint({a: [[1.0]]}, velocity=pushed)
        return pm.Coupler([a, b], [rub, held], dt=0.05, coupling="gc")

    coupler = made()
    coupler.step(5)
    start = coupler.snapshot()
    impulses = []
    for _ in range(2):
        impulses.append(coupler.run(steps=3).contacts["rub"].impulse)
        coupler.restore(start)
    assert impulses[0].max() > 0.0
    assert np.array_equal(*impulses)


def test_the_first_gap_of_a_run_is_that_of_the_obstacle_at_its_time():
    a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="a")
    wall = pm.contact(a, 0, gap=0.02, motion=lambda t: 0.01 * t, name="wall")
    coupler = pm.Coupler([a], wall, dt=0.1)
    whole = coupler.run(steps=6).contacts["wall"].gap[:, 0]
    assert np.allclose(whole, 0.02 - 0.001 * np.arange(7), atol=1e-15)
    start = coupler.snapshot()
    coupler.reset()
    assert np.array_equal(coupler.run(steps=2).contacts["wall"].gap[:, 0], whole[:3])
    coupler.restore(start)
    assert coupler.run(steps=1).contacts["wall"].gap[0, 0] == whole[6]


def test_the_velocity_of_an_obstacle_is_that_of_its_motion_from_the_first_step_on():
    """From motions of order two alone, for which its differences are exact: a ball at rest that is
    hit in the first step has v - d' = - e (0 - d'(0)) after it, of a first step the velocity d' at
    its end; without restitution the ball goes on with the obstacle."""
    h, speed, growth = 0.01, 0.7, 30.0
    for restitution in (0.0, 0.5, 1.0):
        ball = pm.Subdomain([2.0], [0.0], scheme=pm.Newmark(), name="ball")
        wall = pm.contact(
            ball, 0, motion=lambda t: speed * t + 0.5 * growth * t * t, restitution=restitution
        )
        v = pm.Coupler([ball], wall, dt=h).run(steps=4)["ball"].v[:, 0]
        first = speed + growth * h + restitution * speed
        # differences over h / 100, of motions of 1e-2 with rounding of 1e-16 of them
        np.testing.assert_allclose(v[1], first, rtol=1e-11)
        if restitution == 0.0:
            np.testing.assert_allclose(v[1:], speed + growth * h * np.arange(1, 5), rtol=1e-11)


def test_a_contact_is_pickled_with_names():
    _, joint = pounding(4e-3)
    again = pickle.loads(pickle.dumps(joint))
    assert set(again.matrices) == {"a", "b"} and repr(again) == repr(joint)


def test_gaps_and_forces_are_drawn():
    pytest.importorskip("matplotlib")
    history = pounding(4e-3)[0].run(1.0)
    for rows in (None, 0):
        panel = history.contacts[0].plot(rows)
        assert len(panel.figure.axes) == 2
    assert history.contacts[0].plot(0, ax=panel) is panel


def read_vtu(path, k, field):
    meshio = pytest.importorskip("meshio")
    return meshio.read(path.with_suffix("") / f"{k:06d}.vtu").point_data[field]


@pytest.mark.gate
def test_gap_force_and_slip_are_in_the_files_of_paraview(tmp_path):
    """Two blocks on each other, written from the History and read back by meshio."""
    d, mu = 2, 0.3
    moduli = dict(E=100.0, nu=0.2, rho=1.0, mass="lumped")
    low = pm.structures.plate(2, 2, 0.5, **moduli)
    top = pm.structures.plate(2, 2, 0.5, origin=(0.0, 1.0), **moduli)
    below = low.subdomain(scheme=pm.Newmark(), name="below", fixed=low.dofs(low.nodes_at(y=0.0)))
    weight = np.tile([0.2, -1.0], len(top.points)) * top.M.diagonal()
    above = top.subdomain(scheme=pm.Newmark(), name="above", force=weight)
    held = pm.reduce(low.M, low.K, fixed=low.dofs(low.nodes_at(y=0.0)))
    joint = pm.contact_coincident(
        {below: low.points, above: top.points},
        [0.0, 1.0],
        gap=0.01,
        friction=mu,
        reduced={below: held},
    )
    history = pm.Coupler([below, above], joint, dt=0.01, coupling="gc").run(1.0)
    found = history.contacts[joint]
    motions = {"below": held.expand(history["below"].u), "above": history["above"].u}
    faces = {"below": low.nodes_at(y=1.0), "above": top.nodes_at(y=1.0)}
    ux = [motions[name][:, d * face] for name, face in faces.items()]
    slip = (ux[1] - ux[0]) * np.sign(joint.tangents[0][above].data[0])
    for name, mesh in (("below", low), ("above", top)):
        fields = history.contact_fields(mesh, name)
        path = tmp_path / f"{name}.pvd"
        pm.export.write_series(
            path, mesh.points, mesh.elements, history[name].t, motions[name], data=fields
        )
        face, others = faces[name], np.setdiff1d(np.arange(len(mesh.points)), faces[name])
        for k in (0, 30, 100):
            for field, expected in (
                ("gap", found.gap),
                ("contact impulse", found.impulse),
                ("contact force", found.force),
                ("slip", slip),
                ("contact", 1.0 + found.closed),
            ):
                at = read_vtu(path, k, field)
                # what it is made of, summed in another order
                np.testing.assert_allclose(at[face], expected[k], rtol=1e-12, atol=1e-15)
                assert not at[others].any()
    assert found.closed.any() and np.abs(slip).max() > 1e-4


def test_a_cut_writes_its_contacts_with_impulses_since_the_last_macro_step(tmp_path):
    block = pm.structures.plate(4, 5, 0.5, E=100.0, nu=0.3, rho=1.0, mass="lumped")
    low = block.nodes_at(y=0.0)
    v0 = np.zeros(block.n)
    v0[block.dofs(np.arange(len(block.points)), "uy")] = -1.0
    parts = pm.cut(block, layer_of=low, dt=0.1, v0=v0)
    floor = pm.contact(parts.subdomains[1], [f"uy {node}" for node in low], gap=0.1)
    coupler = pm.Coupler(parts.subdomains, [*parts.constraints, floor], dt=0.1, coupling="gc")
    history = coupler.run(2.0)
    parts.export(tmp_path / "run.pvd", history)
    impulse = history.contacts[floor].impulse
    assert impulse.shape[0] == 4 * 20 + 1
    for k in range(1, 21):
        at = read_vtu(tmp_path / "run.pvd", k, "contact impulse")
        np.testing.assert_allclose(at[low], impulse[4 * k - 3 : 4 * k + 1].sum(axis=0), rtol=1e-12)
        force = read_vtu(tmp_path / "run.pvd", k, "contact force")
        np.testing.assert_allclose(force, at / 0.1, rtol=1e-12)
    history.save(tmp_path / "run.npz")
    parts.export(tmp_path / "again.pvd", pm.History.load(tmp_path / "run.npz"))  # the motion alone


def test_fields_of_contacts_need_the_mesh_and_what_was_recorded(tmp_path):
    mesh = pm.structures.plate(2, 1, 1.0, E=100.0, nu=0.0, rho=1.0, mass="lumped")
    plate = mesh.subdomain(scheme=pm.Newmark(), name="plate")
    ground = pm.contact(plate, ["uy 0"], gap=0.01, friction=0.1, tangents=[["ux 0"]], name="ground")
    coupler = pm.Coupler([plate], ground, dt=0.01)
    other = pm.structures.plate(1, 1, 1.0, E=100.0, nu=0.0, rho=1.0)
    history = coupler.run(0.1)
    with pytest.raises(ValueError, match="'plate' must have the 8 dofs of the mesh"):
        history.contact_fields(other, "plate")
    history.save(tmp_path / "run.npz")
    with pytest.raises(ValueError, match="got one of a file"):
        pm.History.load(tmp_path / "run.npz").contact_fields(mesh, "plate")
    coupler.reset()
    few = coupler.run(0.1, record={"plate": [1]})
    with pytest.raises(ValueError, match="'ground' must be recorded, which dof 0 of 'plate'"):
        few.contact_fields(mesh, "plate")


# ---- refusals ------------------------------------------------------------------------------------


def ball(name="ball", **options):
    options = {"scheme": pm.Newmark()} | options
    return pm.Subdomain(options.pop("M", [1.0]), [1.0], name=name, **options)


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_macro_and_mean_coupling_are_refused(coupling):
    a, b = ball("a"), ball("b")
    with pytest.raises(ValueError, match='contacts need coupling "gc" or "pm", got'):
        pm.Coupler([a, b], pm.contact(a, 0, b, 0), dt=0.1, coupling=coupling)


def test_what_contacts_do_not_go_with_is_refused_with_the_row():
    def refused(match, subdomains, constraints, **options):
        with pytest.raises(ValueError, match=match):
            pm.Coupler(subdomains, constraints, **{"dt": 0.1, "coupling": "gc", **options})

    a, b = ball("a"), ball("b")
    joint = pm.contact(a, 0, b, 0, name="joint")
    c = ball("c", substeps=4)
    refused(
        "finest step, 4 substeps, got 1 of 'a' .row 0 of 'joint'",
        [a, b, c],
        [joint, pm.tie(b, 0, c, 0)],
    )
    double = ball("a", double_step=True)
    refused(
        "single steps, got double steps of 'a' .row 0 of 'contact 0'",
        [double, b],
        pm.contact(double, 0, b, 0),
        coupling="pm",
    )
    full = pm.Subdomain([[2.0, 1.0], [1.0, 2.0]], np.eye(2), scheme=pm.Newmark(), name="full")
    refused("diagonal at their dofs .lump the mass., got others at dof 1 of 'full'",
            [full], pm.contact(full, 1))  # fmt: skip
    light = pm.Subdomain([0.0, 1.0], np.eye(2), scheme=pm.GeneralizedAlpha(0.5), name="light")
    refused("dofs with mass, got none at dof 0 of 'light' .row 0", [light], pm.contact(light, 0))
    shaft = pm.Subdomain(
        np.ones(2), [[2.0, 0.5], [-0.5, 2.0]], scheme=pm.Newmark(), symmetric=False, name="shaft"
    )
    refused("symmetric matrices, got others of 'shaft'", [shaft], pm.contact(shaft, 0))
    soft = pm.Subdomain([1.0], None, scheme=pm.Newmark(), internal=pm.CubicSpring([0], 1.0, 1.0))
    refused("without internal forces", [soft], pm.contact(soft, 0))
    refused("row 0 of 'floor'", [ball(u0=[-0.1])], pm.contact("ball", 0, name="floor"))
    held = ball("held")
    driven = pm.Constraint({held: [[1.0]]})
    refused("impulses must be able to change velocities", [held], [driven, pm.contact(held, 0)])
    refused("names of contacts must be different", [a], [pm.contact(a, 0, name="x")] * 2)
    fast = pm.Subdomain([1.0], [1e4], scheme=pm.CentralDifference(), name="fast")
    refused("above the critical one", [fast], pm.contact(fast, 0), dt=0.1)


def test_numbers_out_of_range_are_refused_with_the_row():
    a = ball("a")
    for wrong, match in (
        ({"friction": -0.1, "tangents": [[0]]}, "friction must be at least 0, got -0.1 in row 0"),
        ({"friction": 0.1}, "friction must come with one or two tangents"),
        ({"restitution": 1.5}, r"restitution must lie in \[0, 1\], got 1.5 in row 0"),
        ({"gap": [1.0, 2.0]}, "gap must be a number or of shape"),
        ({"sign": 2}, "sign must be 1 or -1, got 2"),
        ({"sign": np.ones(2)}, "sign must be 1 or -1, got array"),
        ({"tangents": [[0], [0], [0]]}, "tangents must be at most 2, got 3"),
    ):
        with pytest.raises(ValueError, match=match):
            pm.contact(a, 0, **wrong)


def test_what_does_not_know_contacts_says_so():
    coupler, _ = pounding(4e-3)
    for call in (
        lambda: coupler.static(),
        lambda: coupler.run(1.0, tolerance=1e-3),
        lambda: coupler.gradient(pm.Misfit({"a": {"dofs": [0], "u": np.zeros((11, 1))}}), 0.04),
        lambda: pm.analysis.amplification_matrix(coupler),
    ):
        with pytest.raises(ValueError, match="contacts"):
            call()
