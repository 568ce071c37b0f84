"""Multi-support excitation against an adaptive solver and against relative motion."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pmalpha as pm

STIFFNESS = (40.0, 90.0)


def shaken(motion, dt=0.0025):
    """A unit mass between two supports by springs, and its history."""
    k, K = STIFFNESS, np.diag([STIFFNESS[0], sum(STIFFNESS), STIFFNESS[1]])
    K[0, 1] = K[1, 0] = -k[0]
    K[1, 2] = K[2, 1] = -k[1]
    frame = pm.Subdomain([0.1, 1.0, 0.1], K, scheme=pm.GeneralizedAlpha(0.9))
    held = pm.Constraint({frame: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}, velocity=motion)
    return pm.Coupler([frame], held, dt=dt).run(4.0)


def expected(displacement, times):
    def rate(t, y):
        return [y[1], np.dot(STIFFNESS, displacement(t)) - sum(STIFFNESS) * y[0]]

    found = solve_ivp(
        rate, (0.0, 4.0), [0.0, 0.0], "DOP853", t_eval=times, rtol=1e-9, atol=1e-12, max_step=0.02
    )
    return found.y[0]


@pytest.mark.gate
def test_records_of_acceleration_move_the_supports_and_the_mass():
    acceleration, dt = pm.models.el_centro()
    records = np.zeros((201, 2))
    records[:, 0], records[25:, 1] = acceleration[:201], acceleration[:176]  # a wave passes
    motion = pm.SupportMotion(records, dt, "acceleration")
    history = shaken(motion)[0]
    exact = np.array([motion.displacement(t) for t in history.t])
    # displacements are integrated by the scheme, order 2: the error at dt / 2 is a quarter
    scale = np.abs(exact).max()
    assert np.abs(history.u[:, [0, 2]] - exact).max() < 1e-3 * scale
    mass = expected(motion.displacement, history.t)
    error = np.abs(history.u[:, 1] - mass).max()
    finer = shaken(motion, dt=0.00125)[0]
    assert error < 5e-3 * np.abs(mass).max()
    assert np.abs(finer.u[::2, 1] - mass).max() < 0.35 * error


@pytest.mark.gate
def test_records_of_displacement_move_the_supports_and_the_mass():
    t = 0.02 * np.arange(151)
    records = np.transpose([0.1 + 0.02 * np.sin(3.0 * t) ** 2, 0.03 * np.cos(2.0 * t)])
    motion = pm.SupportMotion(records, 0.02, "displacement")
    assert np.abs(motion.displacement(0.0)).max() == np.abs(motion(0.0)).max() == 0.0
    moved = records[77] - records[0]
    assert np.allclose(motion.displacement(t[77]), moved, rtol=1e-12, atol=0.0)
    assert np.all(np.abs(motion(3.5)) < 1e-14)  # at rest after the record
    history = shaken(motion)[0]
    mass = expected(motion.displacement, history.t)
    assert np.abs(history.u[:, 1] - mass).max() < 5e-3 * np.abs(mass).max()


@pytest.mark.parametrize("seed", range(6))
def test_displacements_that_begin_with_a_slope_are_warned_of_with_it(seed):
    # a sine of which the phase makes the slope; the spline through it is exact to order 4, but
    # clamped at the ends, which a tenth of the samples shows
    rng = np.random.default_rng(seed)
    omega, size, dt = rng.uniform(1.0, 5.0), 10.0 ** rng.uniform(-2.0, 2.0), 0.02
    t = dt * np.arange(200)
    still, moving = size * np.cos(omega * t), size * np.sin(omega * t)
    pm.SupportMotion(still, dt, "displacement")  # warnings are errors
    with pytest.warns(pm.AccuracyWarning, match="begins with the slope") as found:
        motion = pm.SupportMotion(np.transpose([still, moving]), dt, "displacement")
    text = str(found[0].message)
    slope = float(text.split("slope ")[1].split(" in column 1")[0])
    assert slope == pytest.approx(size * omega, rel=(omega * dt) ** 2)
    assert np.abs(motion(0.0)).max() == 0.0


def test_equal_motions_of_all_supports_are_a_base_acceleration():
    acceleration, dt = pm.models.el_centro()
    record = acceleration[:201]
    motion = pm.SupportMotion(np.transpose([record, record]), dt, "acceleration")
    absolute = shaken(motion)[0]
    oscillator = pm.Subdomain(
        [1.0],
        [sum(STIFFNESS)],
        scheme=pm.GeneralizedAlpha(0.9),
        force=pm.BaseAcceleration(record, [1.0], [1.0], dt=dt),
    )
    relative = pm.solve(oscillator, 0.0025, 4.0).u[:, 0]
    found = absolute.u[:, 1] - absolute.u[:, 0]
    # two discretizations of order 2
    assert np.abs(found - relative).max() < 1e-2 * np.abs(relative).max()


def test_the_integrals_of_a_record_are_exact():
    motion = pm.SupportMotion([0.0, 6.0], 1.0, "acceleration")  # a = 6 t, then 0
    for t, v, u in ((0.5, 0.75, 0.125), (1.0, 3.0, 1.0), (3.0, 3.0, 7.0)):
        assert motion(t) == pytest.approx([v], rel=1e-14)
        assert motion.displacement(t) == pytest.approx([u], rel=1e-14)
    assert repr(motion) == "<SupportMotion of 1 support, 1 long>"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([1.0], 0.1, "acceleration"), ValueError, "at least 2 samples"),
        (([1.0, np.inf], 0.1, "acceleration"), ValueError, "record must be finite"),
        (([1.0, 2.0], -0.1, "acceleration"), ValueError, "dt must be positive"),
        (([1.0, 2.0], 0.1, "velocity"), ValueError, "kind must be 'acceleration' or 'displace"),
    ],
)
def test_wrong_arguments_are_named(arguments, error, message):
    with pytest.raises(error, match=message):
        pm.SupportMotion(*arguments)
