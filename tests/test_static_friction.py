"""Static and kinetic friction, (U12): breakaway, sliding, and sticking once more."""

import numpy as np
import pytest

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
