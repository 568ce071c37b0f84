"""Contact as constraints: the acceptance statements, against closed forms and a reference."""

import numpy as np
import pytest
from agreement import assert_close, largest
from contact_problems import (
    GAP,
    LENGTH,
    SCHEMES,
    SPEED,
    WAVE,
    E,
    bar,
    bar_on_wall,
    critical,
    energy_star,
)
from contact_reference import run as reference_run
from pairwise import in_turn, pairwise

import pmalpha as pm

ALL = pytest.mark.parametrize("name", SCHEMES)


def ball(scheme, e, t_end, h=1e-3, **options):
    s = pm.Subdomain([2.0], [0.0], scheme=scheme, force=[-20.0], u0=[1.0], name="ball")
    floor = pm.contact(s, [0], restitution=e, name="floor")
    return pm.Coupler([s], floor, dt=h, **options).run(t_end)


# ---- the equations ------------------------------------------------------------------------------


def random_pair(schemes, h, seed=1, **damping):
    """Two subdomains of four dofs; explicit ones at 0.6 of the limit of central difference."""
    rng = np.random.default_rng(seed)
    made = []
    for i, name in enumerate(schemes):
        M, A = rng.uniform(0.5, 2.0, 4), rng.normal(size=(4, 4))
        K, scheme = 3.0 * A @ A.T, SCHEMES[name]
        if scheme.explicit:
            fastest = np.linalg.eigvalsh(K / np.sqrt(np.outer(M, M))).max()
            K *= (1.2 / h) ** 2 / fastest
        B = rng.normal(size=(4, 4))
        C = 0.02 * B @ B.T if damping.get("full") else None
        u0, v0, force = 0.1 * rng.normal(size=4), rng.normal(size=4), rng.normal(size=4)
        v0[3] = 0.3  # tied
        rayleigh = (0.1, 0.01) if damping.get("rayleigh") else None
        options = dict(scheme=scheme, u0=u0, v0=v0, force=force, name=f"s{i}")
        made.append(pm.Subdomain(M, K, C=C, rayleigh=rayleigh, **options))
    return made


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning", "ignore:.*tied and in contact")
@pytest.mark.parametrize(
    ("schemes", "tied", "damping"),
    pairwise(
        [("TR", "CD"), ("rho 0.5", "CD"), ("rho 0.8", "explicit 0.5"), ("rho 0", "TR")],
        [False, True],
        [{}, {"rayleigh": True}, {"full": True}],
    ),
)
def test_every_step_is_that_of_the_reference(schemes, tied, damping):
    h = 0.05
    a, b = random_pair(schemes, h, **damping)
    N = [np.zeros((4, 4)), np.zeros((4, 4))]
    for k in range(2):
        N[0][k, k], N[1][k, k] = -1.0, 1.0
    N[0][2, [0, 2]], N[1][3, 2] = 0.5, -1.0
    L = [np.zeros((int(tied), 4)), np.zeros((int(tied), 4))]
    if tied:
        L[0][0, 3], L[1][0, 3] = 1.0, -1.0
    gap, e = np.array([0.25, 0.25, 0.2, 0.3]), np.array([0.0, 0.5, 1.0, 0.2])
    joint = pm.Contact({a: N[0], b: N[1]}, gap=gap, restitution=e)
    ties = [pm.tie(a, [3], b, [3])] if tied else []
    coupler = pm.Coupler([a, b], [*ties, joint], dt=h, coupling="gc", threads=1)
    w0 = [coupler.state(0).a, coupler.state(1).a]
    history = coupler.run(steps=120)
    path = reference_run([a, b], L, N, gap, e, h, 120, w0)
    impulses = np.array([P for _, _, P in path])
    assert (impulses > 0.0).sum() > 2  # or nothing was compared
    # rounding: two to three digits above that of a step, after 120 of them
    size, at = largest(impulses), {"times": history.macro_times[1:]}
    got = history.contacts[joint].impulse
    assert_close(got, impulses, 1e-12, "impulse", size=max(1.0, size), column="contact", **at)
    for i in range(2):
        u, what = np.array([u[i] for u, _, _ in path]), f"displacement of subdomain {i}"
        assert_close(history[i].u, u, 1e-12, what, size=largest(u), times=history.macro_times)


# ---- 1: a ball ----------------------------------------------------------------------------------


@ALL
def test_a_ball_that_is_thrown_back_keeps_its_height(name):
    history = ball(SCHEMES[name], 1.0, 9.4)
    impacts = np.flatnonzero(history.contacts["floor"].closed)
    assert impacts.size >= 10
    height = history["ball"].u[impacts[9] : impacts[9] + 890].max()
    assert abs(height - 1.0) < 1e-11


@pytest.mark.parametrize(("name", "h"), in_turn(SCHEMES, 4e-3, 1e-3))
def test_restitution_takes_its_part_of_each_of_ten_impacts(name, h):
    history = ball(SCHEMES[name], 0.8, 3.96, h)
    u, impacts = history["ball"].u[:, 0], np.flatnonzero(history.contacts[0].closed)
    fall = np.sqrt(2.0 / 10.0)
    apex = impacts[9] + np.argmax(u[impacts[9] : impacts[10]])
    exact = fall * (1.0 + 2.0 * sum(0.8**k for k in range(1, 10)) + 0.8**10)
    # each impact is found up to a step late
    assert abs(history["ball"].t[apex] - exact) < 8.0 * h
    assert abs(u[apex] - 0.8**20) < 1e-3


def test_all_schemes_agree_on_a_ball():
    paths = [ball(scheme, 0.8, 2.0)["ball"].u for scheme in SCHEMES.values()]
    for path in paths[1:]:
        np.testing.assert_allclose(path, paths[0], atol=1e-12)


def test_a_grazing_impact_between_two_levels_is_missed_and_has_a_small_velocity():
    """A path that bends away by a, deeper than the floor by less than a h^2 / 8 between two levels,
    meets it at less than a h / 2: the impulse that is missed is of order h, as of any impact."""
    h, a, depth = 0.01, 2.0, 0.9 * 2.0 * 0.01**2 / 8.0
    for middle, is_missed in ((0.505, True), (0.5, False)):  # between two levels, and at one
        s = pm.Subdomain([1.0], [0.0], scheme=pm.Newmark(), force=[a], v0=[-a * middle])
        floor = pm.contact(s, 0, gap=0.5 * a * middle**2 - depth, restitution=1.0)
        history = pm.Coupler([s], floor, dt=h).run(1.0)
        assert history.contacts[0].closed.any() != is_missed
        met = np.sqrt(2.0 * a * depth)
        exact = a * (1.0 - middle) + 2.0 * met
        assert met < 0.5 * a * h
        assert abs(history[0].v[-1, 0] - exact) < a * h  # (1 + e) a h / 2


@ALL
def test_a_ball_at_rest_pushes_with_its_weight(name):
    floor = ball(SCHEMES[name], 0.0, 2.0).contacts[0]
    np.testing.assert_allclose(floor.force[-1000:], 20.0, rtol=1e-9)


# ---- 2, 3: a bar on a wall ----------------------------------------------------------------------


def rebound(s, history, h):
    """Contact time, rms of the force on its plateau, momentum and E* after the rebound."""
    wall = history.contacts["wall"]
    on = np.flatnonzero(wall.closed[:, 0])
    last = 2.0 * LENGTH / WAVE
    first = GAP / SPEED
    plateau = (wall.t > first + 0.2 * last) & (wall.t < first + 0.8 * last)
    force = wall.force[plateau, 0] / (WAVE * SPEED)
    motion = history["bar"]
    start = 0.5 * LENGTH * SPEED**2
    return (
        (on[-1] - on[0] + 1) * h / last,
        np.sqrt(np.mean((force - 1.0) ** 2)),
        motion.v[-1] @ s.M / (LENGTH * SPEED),
        energy_star(s, h, motion.u[-1:], motion.v[-1:], motion.a[-1:])[0] / start,
    )


def test_central_difference_finds_the_force_of_a_bar_on_a_wall():
    time, rms, momentum, left = rebound(*bar_on_wall(pm.CentralDifference(), 100, 0.9))
    assert abs(time - 1.0) < 0.01
    assert rms < 0.005
    assert abs(momentum - 0.988) < 0.005
    assert abs(left - 0.992) < 0.003


def test_the_energy_of_the_contact_node_is_lost_and_falls_with_the_mesh():
    left = [rebound(*bar_on_wall(pm.CentralDifference(), n, 0.9))[3] for n in (100, 200)]
    assert 1.0 - left[1] < 0.6 * (1.0 - left[0]) and 1.0 - left[1] < 0.005


def test_the_trapezoidal_rule_does_too():
    _, rms, _, left = rebound(*bar_on_wall(pm.Newmark(), 100, 1.0))
    assert rms < 0.005
    assert left > 0.99


@pytest.mark.parametrize(
    ("name", "cfl"),
    [*in_turn(("TR", "rho 0.8", "rho 0.5", "rho 0"), 0.5, 1.0, 3.0, 10.0)]
    + [("TR", 10.0), ("rho 0.5", 1.0), ("CD", 0.5), ("CD", 0.9), ("CD", 0.99)]
    + [(f"explicit {rho}", 0.5) for rho in ("0.8", "0.5", "0")],
)
def test_a_bar_on_a_wall_never_gains_energy(name, cfl):
    n = 100
    s, history, h = bar_on_wall(SCHEMES[name], n, cfl)
    motion, start = history["bar"], 0.5 * LENGTH * SPEED**2
    # by elongations: u K u of a bar that has moved by 5 rounds by 1e-11 of the energy
    energy = 0.5 * E * n / LENGTH * np.sum(np.diff(motion.u, axis=1) ** 2, axis=1)
    energy += 0.5 * motion.v**2 @ s.M
    if name == "CD":  # E*
        energy += 0.5 * h**2 * (s.scheme.beta - 0.25) * motion.a**2 @ s.M
    assert energy.max() / start < 1.0 + 1e-12


# ---- 4: energy ----------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("seed, e", [(1, 0.0), (2, 0.5), (3, 0.5), (4, 1.0), (5, 1.0)])
def test_energy_changes_by_the_work_of_the_impulses_alone(seed, e):
    h = 0.05
    a, b = random_pair(("TR", "CD"), h, seed)
    a, b = (pm.Subdomain(s.M, s.K, scheme=s.scheme, u0=s.u0, v0=s.v0, name=s.name) for s in (a, b))
    joint = pm.contact(a, [0, 1, 2], b, [0, 1, 2], gap=0.5, restitution=e)
    history = pm.Coupler([a, b], joint, dt=h, coupling="gc").run(steps=400, energy=True)
    # in long double, since u K u cancels where a soft mode has moved far
    total = sum(energy_star(s, h, x.u, x.v, x.a) for s, x in zip((a, b), history.subdomains))
    P = history.contacts[joint].impulse
    y = history["s1"].v[:, :3] - history["s0"].v[:, :3]
    work = np.sum(P[1:] * (y[1:] + y[:-1]) / 2.0, axis=1)
    assert np.count_nonzero(P) > 10
    assert np.abs(np.diff(total) - work).max() < 1e-13 * total[0]
    np.testing.assert_allclose(
        np.diff(history.energy.contact.sum(axis=1)), work, atol=1e-13 * float(total[0])
    )
    if e == 1.0:
        assert abs(total[-1] / total[0] - 1.0) < 1e-11
    else:
        assert np.diff(total).max() < 1e-13 * total[0]


def test_the_balance_closes_with_the_work_of_contact():
    _, history, _ = bar_on_wall(pm.Newmark(), 20, 1.0)
    start = 0.5 * LENGTH * SPEED**2
    assert history.energy.contact.min() < -1e-3 * start
    assert np.abs(history.energy.balance).max() < 1e-12 * start


# ---- 5: two bars --------------------------------------------------------------------------------


def two_bars(n, cfl, schemes, coupling="gc"):
    M, K = bar(n)
    h = cfl * critical(n)
    options = [{"v0": np.full(n + 1, SPEED), "name": "A"}, {"name": "B"}]
    a, b = (pm.Subdomain(M, K, scheme=SCHEMES[x], **o) for x, o in zip(schemes, options))
    joint = pm.contact(a, [n], b, [0], gap=0.5, name="joint")
    coupler = pm.Coupler([a, b], joint, dt=h, coupling=coupling)
    return coupler.run(steps=round(1.0 / h))


def test_two_bars_exchange_their_velocities():
    history = two_bars(100, 0.9, ("TR", "CD"))
    M, _ = bar(100)
    assert history["B"].v[-1] @ M / (LENGTH * SPEED) > 0.99
    momentum = sum(s.v @ M for s in history.subdomains)
    np.testing.assert_allclose(momentum, LENGTH * SPEED, rtol=1e-12)


def layered(coupling, substeps, scheme):
    """A strikes B, whose front is a layer at the finest step, tied to the coarse rest."""
    n, layer = 100, 10
    M, K = bar(n)
    h = 0.9 * critical(n)
    first, second = np.arange(layer + 1), np.arange(layer, n + 1)
    thin_M, thin_K = M[first].copy(), K[np.ix_(first, first)].copy()
    thin_M[-1] /= 2.0
    thin_K[-1, -1] /= 2.0
    rest_M, rest_K = M[second].copy(), K[np.ix_(second, second)].copy()
    rest_M[0] /= 2.0
    rest_K[0, 0] /= 2.0
    fine = {"scheme": pm.CentralDifference(), "substeps": substeps}
    a = pm.Subdomain(M, K, v0=np.full(n + 1, SPEED), name="A", **fine)
    thin = pm.Subdomain(thin_M, thin_K, name="layer", **fine)
    rest = pm.Subdomain(rest_M, rest_K, scheme=scheme, name="rest")
    joint = pm.contact(a, [n], thin, [0], gap=0.5, name="joint")
    ties = pm.tie(thin, [layer], rest, [0])
    coupler = pm.Coupler([a, thin, rest], [ties, joint], dt=substeps * h, coupling=coupling)
    history = coupler.run(steps=round(1.0 / (substeps * h)), energy=True)
    moved = history["layer"].v[-1] @ thin_M + history["rest"].v[-1] @ rest_M
    return moved / (LENGTH * SPEED), history


@pytest.mark.parametrize(("coupling", "least"), [("gc", 0.975), ("pm", 0.965)])
def test_a_layer_at_the_finest_step_is_struck_with_subcycling_behind_it(coupling, least):
    moved, history = layered(coupling, 5, pm.Newmark())
    assert moved > least
    energy = (history.energy.kinetic + history.energy.strain).sum(axis=1)
    assert energy.max() <= (1.0 + 1e-12) * energy[0]
    assert history.contacts["joint"].t.size == history.multiplier_times.size


# ---- 6, 7: lasting contact ----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["TR", "rho 0.5", "CD"])
def test_a_bar_on_the_floor_does_not_sink(name):
    n, drop = 10, 0.05
    M, K = bar(n)
    h = (0.9 if name == "CD" else 3.0) * critical(n)
    C = 0.5 * np.diag(M)  # so that it comes to rest
    weight = -M
    s = pm.Subdomain(M, K, C=C, scheme=SCHEMES[name], force=weight, name="bar")
    floor = pm.contact(s, [0], gap=drop)
    history = pm.Coupler([s], floor, dt=h).run(steps=10_000, every=1)
    gap, force = (getattr(history.contacts[0], x)[:, 0] for x in ("gap", "force"))
    assert abs(gap[10_000] - gap[5_000]) < 1e-12
    np.testing.assert_allclose(force[-1000:], LENGTH, rtol=1e-9)
    impact = np.sqrt(2.0 * drop)  # the damping of the fall takes 5 per cent
    assert gap.min() > -5.0 * h * impact


def test_lasting_contact_is_of_order_two():
    rng = np.random.default_rng(4)
    A = rng.normal(size=(3, 3))
    K = A @ A.T + np.eye(3)

    def end(steps, scheme):
        h = 1.0 / steps
        s = pm.Subdomain(
            [1.0, 1.5, 0.5],
            K,
            scheme=scheme,
            force=lambda t: [-5.0 - np.sin(3 * t), np.cos(2 * t), 0.0],
        )
        stop = pm.contact(s, [0])
        history = pm.Coupler([s], stop, dt=h).run(1.0)
        assert history.contacts[0].closed[1:].all()
        return history[0].u[-1], history[0].v[-1]

    for scheme in (pm.Newmark(), pm.CentralDifference(), pm.GeneralizedAlpha(0.5)):
        u, v = zip(*(end(k, scheme) for k in (40, 80, 160)))
        for x in (u, v):
            order = np.log2(np.linalg.norm(x[0] - x[1]) / np.linalg.norm(x[1] - x[2]))
            assert 1.9 < order < 2.1


# ---- 8: friction --------------------------------------------------------------------------------


def slope(h, mu=0.5, tangent=0.2, v0=2.0, t_end=1.0, scheme=None):
    """A block slides up to its stop on a plane inclined by a small angle: g = 10."""
    g, angle = 10.0, np.arctan(tangent)
    load = g * np.array([np.sin(angle), -np.cos(angle)])
    s = pm.Subdomain(
        [1.0, 1.0],
        [0.0, 0.0],
        scheme=scheme or pm.Newmark(),
        force=load,
        v0=[v0, 0.0],
        name="block",
    )
    plane = pm.contact(s, [1], friction=mu, tangents=[[0]], name="plane")
    return pm.Coupler([s], plane, dt=h).run(t_end), g * np.cos(angle), mu, tangent


@pytest.mark.parametrize("name", ["TR", "rho 0.5", "CD"])
def test_a_block_on_a_slope_stops_where_coulomb_says(name):
    h = 0.01
    history, normal, mu, tangent = slope(h, t_end=11.0, scheme=SCHEMES[name])
    slowing = normal * (mu - tangent)
    u, plane = history["block"].u[:, 0], history.contacts["plane"]
    assert abs(u[-1] - 2.0**2 / (2.0 * slowing)) < 3e-6
    creep = np.abs(np.diff(u[-1000:])).max()
    if name == "rho 0.5":  # u is a sum of three numbers that are not zero: its last digit
        assert creep <= np.spacing(u[-1])
    else:
        assert creep == 0.0
    ratio = plane.friction[-20:, 0, 0] / plane.impulse[-20:, 0]
    np.testing.assert_allclose(-ratio, tangent, rtol=1e-9)


def test_a_spring_with_dry_friction_rests_where_its_half_cycles_end():
    # mu N / k = 0.1: each half cycle takes 0.2 from u0 = 1.05; at -0.05 the spring is too weak
    s = pm.Subdomain([1.0, 1.0], [1.0, 0.0], scheme=pm.Newmark(), force=[0.0, -1.0], u0=[1.05, 0.0])
    plane = pm.contact(s, [1], friction=0.1, tangents=[[0]])
    history = pm.Coupler([s], plane, dt=0.1).run(25.0)
    assert abs(history[0].u[-1, 0] + 0.05) < 1e-3


def test_two_tangents_slide_on_a_cone_in_the_direction_of_the_velocity():
    v = np.array([1.2, 0.5])
    s = pm.Subdomain(
        np.ones(3), np.zeros(3), scheme=pm.Newmark(), force=[0.0, 0.0, -10.0], v0=[*v, 0.0]
    )
    plane = pm.contact(s, [2], friction=0.3, tangents=[[0], [1]])
    history = pm.Coupler([s], plane, dt=0.01).run(1.0)
    end = history[0].u[-1, :2]
    assert abs(end[0] * v[1] - end[1] * v[0]) < 1e-12
    assert abs(np.linalg.norm(end) - (v @ v) / 6.0) < 1e-4
    assert history.contacts[0].friction.shape == (101, 1, 2)


# ---- meshes face to face -------------------------------------------------------------------------


def stacked(d=2, lift=0.0, scheme=None, **kind):
    """Two blocks of elements, one above the other, and their contact; the lower one is held."""
    make = {2: pm.structures.plate, 3: pm.structures.solid}[d]
    up = np.eye(d)[-1]
    counts, moduli = (2,) * d, dict(E=100.0, nu=0.2, rho=1.0, mass="lumped")
    low, top = make(*counts, 0.5, **moduli), make(*counts, 0.5, **moduli, origin=up)
    foot = low.dofs(low.nodes_at(**{"xyz"[d - 1]: 0.0}))
    held = pm.reduce(low.M, low.K, fixed=foot)
    scheme = scheme or pm.CentralDifference()
    below = pm.Subdomain(held.M, held.K, scheme=scheme, name="below")
    weight = np.tile(-up, len(top.points)) * top.M.diagonal()
    above = pm.Subdomain(
        top.M.diagonal(),
        top.K,
        scheme=scheme,
        force=weight,
        u0=np.tile(lift * up, top.n // d),
        name="above",
    )
    joint = pm.contact_coincident(
        {below: low.points, above: top.points}, 3.0 * up, gap=0.0, reduced={below: held}, **kind
    )
    return below, above, joint, low, top, held


@pytest.mark.parametrize("d", [2, 3])
def test_coincident_nodes_have_a_row_each_along_the_normal(d):
    below, above, joint, low, top, held = stacked(d, friction=0.3, name="joint")
    face = low.nodes_at(**{"xyz"[d - 1]: 1.0})
    assert joint.rows == len(face) == 3 ** (d - 1) and joint.name == "joint"
    rng = np.random.default_rng(0)
    ua, ub = rng.normal(size=(len(low.points), d)), rng.normal(size=(len(top.points), d))
    ua[low.nodes_at(**{"xyz"[d - 1]: 0.0})] = 0.0
    other = top.nodes_at(**{"xyz"[d - 1]: 1.0})
    jump = ub[other] - ua[face]

    def of(matrices):
        return matrices[below] @ ua.ravel()[held.free] + matrices[above] @ ub.ravel()

    assert np.allclose(of(joint.matrices), jump[:, -1], rtol=1e-14)
    along = np.transpose([of(T) for T in joint.tangents])
    assert along.shape == (joint.rows, d - 1)
    assert np.allclose(np.sum(along**2, axis=1), np.sum(jump[:, :-1] ** 2, axis=1), rtol=1e-13)


def test_a_block_that_lands_on_another_never_gains_energy():
    def work(friction):
        below, above, joint, *_ = stacked(lift=0.01, scheme=pm.Newmark(), friction=friction)
        history = pm.Coupler([below, above], joint, dt=0.01, coupling="gc").run(2.0, energy=True)
        energy = history.energy
        assert history.contacts[joint].closed.any(axis=0).all()
        assert np.max(np.abs(energy.balance.sum(axis=1))) < 1e-9 * energy.kinetic.max()
        return energy.contact.sum(axis=1)

    smooth, rough = work(0.0), work(0.3)
    assert np.all(np.diff(smooth) <= 1e-15) and smooth[-1] < 0.0
    assert rough[-1] < 1.1 * smooth[-1]  # friction takes a fifth more


def test_friction_returns_energy_only_where_sliding_ends_against_its_direction():
    below, above, joint, *_ = stacked(lift=0.01, scheme=pm.Newmark(), friction=0.3)
    history = pm.Coupler([below, above], joint, dt=0.01, coupling="gc").run(2.0, energy=True)
    rise = np.diff(history.energy.contact.sum(axis=1))
    sliding = sum(T @ history[s.name].v.T for s, T in joint.tangents[0].items()).T
    friction = history.contacts[joint].friction[1:, :, 0]
    returned = np.maximum(friction * sliding[:-1], 0.0).sum(axis=1) / 2.0
    assert 1e-8 < returned.max() and np.count_nonzero(rise > 1e-16) == 1
    # P_n y_n and P_t y_t at the end of a step: rounding of the largest impulse and velocity
    assert np.all(rise <= returned + 1e-16)


def test_what_does_not_fit_face_to_face_is_refused_by_name():
    below, above, _, low, top, held = stacked()
    points = {below: low.points, above: top.points}
    for arguments, message in (
        (({below: low.points}, [0.0, 1.0]), "two subdomains"),
        ((points, [0.0, 0.0]), "length 0"),
        ((points, [0.0, 0.0, 1.0]), "normal must have shape"),
    ):
        with pytest.raises(ValueError, match=message):
            pm.contact_coincident(*arguments, reduced={below: held})


def test_rows_of_interpolate_are_gaps_of_meshes_that_do_not_match():
    """Three nodes on the face of two elements, one of them between its nodes; pressed together."""
    low = pm.structures.plate(2, 1, 1.0, E=100.0, nu=0.0, rho=1.0, mass="lumped")
    top = pm.structures.plate(3, 1, [2.0 / 3.0, 1.0], E=100.0, nu=0.0, rho=1.0, mass="lumped")
    shift = np.array([0.0, 1.0])
    face, other = low.nodes_at(y=1.0), top.nodes_at(y=0.0)
    foot = low.dofs(low.nodes_at(y=0.0))
    held = pm.reduce(low.M, low.K, fixed=foot)
    below = pm.Subdomain(held.M, held.K, scheme=pm.Newmark(), name="below")
    push = np.zeros(top.n)
    push[top.dofs(top.nodes_at(y=1.0), "uy")] = [-1.0, -2.0, -2.0, -1.0]
    above = pm.Subdomain(
        top.M.diagonal(), top.K, C=0.5 * top.M, scheme=pm.Newmark(), force=push, name="above"
    )
    rows = pm.interpolate(
        above,
        top.points + shift,
        below,
        low.points,
        np.column_stack([face[:-1], face[1:]]),
        nodes_a=other,
        components=2,
        reduced={below: held},
    )
    gap = pm.Contact({s: L[1::2] for s, L in rows.matrices.items()}, name="face")
    assert gap.rows == 4
    u = np.zeros((len(top.points), 2))
    u[other, 1] = [1.0, 2.0, 3.0, 4.0]
    assert np.allclose(gap.matrices[above] @ u.ravel(), [1.0, 2.0, 3.0, 4.0])
    found = pm.Coupler([below, above], gap, dt=0.01, coupling="gc").run(5.0).contacts["face"]
    assert found.gap.min() > -1e-3
    assert abs(found.impulse.sum() - 6.0 * 5.0) < 0.05 * 30.0  # the load's, less what still moves
