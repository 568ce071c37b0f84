"""Static and kinetic friction, (U12): breakaway, sliding, and sticking once more."""

import numpy as np
import pytest
from contact_problems import SCHEMES
from contact_reference import run as reference_run

import pmalpha as pm

WEIGHT, STATIC, KINETIC = 10.0, 0.3, 0.2
H = 1e-3


def block(pull, t_end=2.0, h=H, tangents=1, scheme=None, **friction):
    """A unit mass that is pressed on a floor by 10 and pulled along it by pull(t); its history."""
    scheme = pm.CentralDifference() if scheme is None else scheme
    t = h * np.arange(round(t_end / h) + 2)
    force = np.zeros((t.size, 1 + tangents))
    force[:, 0] = -WEIGHT
    force[:, 1:] = np.transpose(np.atleast_2d(pull(t)))
    n = 1 + tangents
    s = pm.Subdomain(
        np.ones(n), np.zeros(n), scheme=scheme, force=pm.SampledForce(force, h), name="s"
    )
    options = dict(friction=KINETIC, friction_static=STATIC) | friction
    floor = pm.contact(s, [0], tangents=[[k] for k in range(1, n)], name="floor", **options)
    return pm.Coupler([s], floor, dt=h)


def sliding(history):
    return np.abs(history["s"].v[:, 1:]).max(axis=1) > 1e-12


@pytest.mark.parametrize("scheme", [pm.CentralDifference(), pm.Newmark(), pm.GeneralizedAlpha(0.5)])
def test_a_block_breaks_away_at_static_friction_and_slides_with_the_kinetic_one(scheme):
    history = block(lambda t: 2.0 * t, scheme=scheme).run(2.0)
    s, start = history["s"], STATIC * WEIGHT / 2.0
    begins = s.t[np.argmax(sliding(history))]
    assert start - 1e-9 < begins <= start + 2.0 * H  # the first step whose force is above
    # x'' = 2 t - mu N from rest: the instant is known to two steps
    exact = (2.0**2 - start**2) - KINETIC * WEIGHT * (2.0 - start)
    assert s.v[-1, 1] == pytest.approx(exact, abs=3.0 * H)
    friction = history.contacts["floor"].friction[:, 0, 0] / H
    moves = sliding(history)[1:] & (s.t[1:] > begins + 2.0 * H)
    # a step's impulse, of a force that an implicit scheme averages over it
    assert np.allclose(friction[1:][moves], -KINETIC * WEIGHT, rtol=1e-9, atol=0.0)
    assert abs(friction).max() <= STATIC * WEIGHT * (1.0 + 1e-12)
    assert abs(friction).max() > 0.99 * STATIC * WEIGHT  # it was reached


def test_a_block_that_has_come_to_rest_needs_static_friction_to_start_again():
    # 4 for 0.5 s, then 2.5, between both limits: it slides on, since 2.5 > 2; with -1 it stops
    def pull(t):
        return np.where(t < 0.5, 4.0, np.where(t < 1.0, 2.5, np.where(t < 1.5, -1.0, 2.5)))

    history = block(pull, t_end=3.0).run(3.0)
    s = history["s"]
    v = dict(zip(s.t.round(3).tolist(), s.v[:, 1].tolist()))
    # velocities 2 x 0.5 and + 0.5 x 0.5, each change of the force a step late at most
    assert v[0.5] == pytest.approx(1.0, abs=3.0 * H)
    assert v[1.0] == pytest.approx(1.25, abs=6.0 * H)
    stops = 1.0 + v[1.0] / 3.0  # -1 and friction of -2
    assert v[round(stops + 0.01, 3)] == 0.0
    assert np.all(s.v[s.t > stops + 0.01, 1] == 0.0)  # 2.5 does not start it again
    kinetic = block(pull, t_end=3.0, friction_static=KINETIC).run(3.0)
    assert kinetic["s"].v[-1, 1] > 0.5  # with kinetic friction alone it does


def test_a_block_at_rest_at_the_start_has_static_friction():
    history = block(lambda t: 2.5 + 0.0 * t).run(0.5)
    assert np.abs(history["s"].u[:, 1]).max() < 1e-18  # rounding of impulses of 0.0025
    assert block(lambda t: 2.5 + 0.0 * t, friction_static=KINETIC).run(0.5)["s"].u[-1, 1] > 0.05


def test_a_force_that_passes_kinetic_friction_in_a_step_exactly_does_not_start_it():
    # the impulse is mu P_n where t = 1, to the last bit or so, and nothing moves
    history = block(lambda t: KINETIC * WEIGHT * np.minimum(t, 1.0)).run(2.0)
    assert np.abs(history["s"].v[:, 1]).max() < 1e-18  # rounding of impulses of 0.002


def test_in_the_plane_the_block_starts_along_the_force():
    history = block(lambda t: np.array([1.6 * t, 1.2 * t]), tangents=2).run(2.0)
    s = history["s"]
    begins = s.t[np.argmax(sliding(history))]
    assert STATIC * WEIGHT / 2.0 - 1e-9 < begins <= STATIC * WEIGHT / 2.0 + 2.0 * H
    assert s.v[-1, 2] == pytest.approx(0.75 * s.v[-1, 1], rel=1e-9)


@pytest.mark.parametrize("scheme", [pm.CentralDifference(), pm.Newmark(), pm.GeneralizedAlpha(0.5)])
@pytest.mark.parametrize("factor", [1.0, 0.1])
def test_a_pad_that_turns_where_static_friction_holds_it_stays_whatever_the_step(scheme, factor):
    """Released at u0 = 0.11 it turns at -(u0 - 2 mu N / k) = -0.05, where k |u| = 5 is below the
    static friction of 6 and above the kinetic one of 3: without the test with mu_s in the step in
    which it turns it slid on in a third of all steps, of any length."""
    for h in factor * H * (1.0 + 0.05 * np.arange(12)):
        s = pm.Subdomain(
            [1.0, 1.0], [0.0, 100.0], scheme=scheme, u0=[0.0, 0.11], force=[-10.0, 0.0]
        )
        pad = pm.contact(s, [0], friction=0.3, friction_static=0.6, tangents=[[1]])
        u = pm.Coupler([s], pad, dt=h).run(steps=round(0.6 / h))["subdomain 0"].u[:, 1]
        assert u[-1] == pytest.approx(-0.05, abs=2.0 * h), h  # a step of the friction that turns
        assert np.abs(np.diff(u[-20:])).max() < 1e-16  # rounding of 0.05


def test_a_pad_that_turns_where_the_pull_is_above_static_friction_slides_back():
    """As above from u0 = 0.13: it turns at -0.07, where k |u| = 7 is above 6; then at 0.01."""
    s = pm.Subdomain(
        [1.0, 1.0], [0.0, 100.0], scheme=pm.Newmark(), u0=[0.0, 0.13], force=[-10.0, 0.0]
    )
    pad = pm.contact(s, [0], friction=0.3, friction_static=0.6, tangents=[[1]])
    u = pm.Coupler([s], pad, dt=1e-3).run(1.0)["subdomain 0"].u[:, 1]
    assert u.min() == pytest.approx(-0.07, abs=2e-3) and u[-1] == pytest.approx(0.01, abs=4e-3)


def test_in_the_plane_a_pad_that_turns_is_held_too():
    s = pm.Subdomain(
        np.ones(3),
        [0.0, 100.0, 100.0],
        scheme=pm.Newmark(),
        u0=[0.0, 0.066, 0.088],
        force=[-10, 0, 0],
    )
    pad = pm.contact(s, [0], friction=0.3, friction_static=0.6, tangents=[[1], [2]])
    u = pm.Coupler([s], pad, dt=1.07e-3).run(steps=560)["subdomain 0"].u[-1]
    np.testing.assert_allclose(u[1:], [-0.03, -0.04], atol=2e-3)


def test_equal_coefficients_are_bitwise_friction_alone():
    def pull(t):
        return 3.0 * np.sin(5.0 * t)

    alone = block(pull, friction_static=None).run(2.0)
    equal = block(pull, friction_static=KINETIC).run(2.0)
    assert np.array_equal(alone["s"].u, equal["s"].u)
    assert not np.array_equal(alone["s"].u, block(pull).run(2.0)["s"].u)


def test_a_run_in_pieces_and_from_a_file_is_bitwise_the_same(tmp_path):
    def pull(t):
        return 4.0 * np.sin(5.0 * t)

    whole = block(pull).run(2.0)
    coupler = block(pull)
    coupler.step(777)
    coupler.save(tmp_path / "half.npz")
    other = block(pull)
    other.load(tmp_path / "half.npz")
    assert np.array_equal(other.run(2.0)["s"].u, whole["s"].u[777:])
    with pytest.raises(ValueError, match="friction_static"):
        block(pull, friction_static=0.35).load(tmp_path / "half.npz")


def test_contacts_that_hold_each_other_break_away_together():
    # two blocks on a stiff bar: the load is on one, and both stick until it exceeds both limits
    k = 1e4
    K = np.zeros((4, 4))
    K[:2, :2] = [[k, -k], [-k, k]]
    t = H * np.arange(2002)
    force = np.zeros((t.size, 4))
    force[:, 0], force[:, 2:] = 4.0 * t, -WEIGHT
    s = pm.Subdomain(np.ones(4), K, scheme=pm.Newmark(), force=pm.SampledForce(force, H), name="s")
    floor = pm.contact(s, [2, 3], friction=KINETIC, friction_static=STATIC, tangents=[[0, 1]])
    history = pm.Coupler([s], floor, dt=H).run(2.0)
    moves = np.abs(history["s"].v[:, :2]) > 1e-12
    begins = history["s"].t[np.argmax(moves, axis=0)]
    # the first at 3 = mu_s N. The other is pulled by 4 t less 2 to 3, as the first slides or sticks
    assert begins[0] == pytest.approx(0.75, abs=2.0 * H)
    assert 1.2 < begins[1] <= 1.5
    assert np.abs(history.contacts[0].friction).max() <= STATIC * WEIGHT * H * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"friction": 0.3, "friction_static": 0.2}, "friction_static must be at least friction"),
        ({"friction": 0.0, "friction_static": 0.2}, "friction must be positive where"),
        ({"friction": 0.1, "friction_static": -0.2}, "friction_static must be at least 0, got"),
    ],
)
def test_bad_coefficients_are_refused_by_name(options, message):
    s = pm.Subdomain([1.0, 1.0], [1.0, 1.0], scheme=pm.Newmark())
    with pytest.raises(ValueError, match=message):
        pm.contact(s, [0], tangents=[[1]], **options)


@pytest.mark.parametrize("schemes", [("TR", "CD"), ("rho 0.5", "TR"), ("rho 0.8", "explicit 0.5")])
def test_every_step_with_static_friction_is_that_of_the_reference(schemes):
    """Two blocks, of two dofs each, on a floor and against each other, pulled to and fro."""
    h, steps = 0.02, 300
    made = [
        pm.Subdomain(
            [1.0 + i, 1.0 + i],
            np.diag([5.0, 4.0]),
            scheme=SCHEMES[name],
            force=[-4.0, 3.6 - 5.1 * i],
            v0=[-1.0, 1.5 - i],
            name="ab"[i],
        )
        for i, name in enumerate(schemes)
    ]
    a, b = made
    N = [np.zeros((4, 2)), np.zeros((4, 2))]
    N[0][0, 0], N[0][2, 1] = 1.0, 1.0  # a on the floor
    N[1][1, 0], N[1][3, 1] = 1.0, 1.0  # b on a
    N[0][1, 0], N[0][3, 1] = -1.0, -1.0
    mu, static, gap, e = np.full(2, 0.2), np.array([0.35, 0.5]), np.full(2, 0.05), np.zeros(2)
    options = {"friction": mu, "friction_static": static, "gap": gap}
    normals, tangents = ({s: R[rows] for s, R in zip(made, N)} for rows in ([0, 1], [2, 3]))
    joint = pm.Contact(normals, tangents=[tangents], **options)
    coupler = pm.Coupler(made, joint, dt=h, coupling="gc")
    w0 = [coupler.state(0).a, coupler.state(1).a]
    history = coupler.run(steps=steps)
    path = reference_run(
        made, [np.zeros((0, 2))] * 2, N, gap, e, h, steps, w0, friction=(mu, static)
    )
    P = np.array([P for _, _, P in path])
    on = np.abs(P[:, 2:]) > 0.2 * (1.0 + 1e-9) * P[:, :2]  # beyond the kinetic friction
    slides = np.isclose(np.abs(P[:, 2:]), 0.2 * P[:, :2], rtol=1e-9, atol=0.0) & (P[:, :2] > 0.0)
    assert on.any(axis=0).all() and slides.any(axis=0).all()
    got = history.contacts[joint]
    # rounding, two to three digits above that of a step after 300 of them
    np.testing.assert_allclose(got.impulse, P[:, :2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.friction[..., 0], P[:, 2:], rtol=0, atol=1e-12)
    for i in range(2):
        expected = np.array([u[i] for u, _, _ in path])
        np.testing.assert_allclose(history[i].u, expected, rtol=0, atol=1e-12)
