"""Textbook examples of elastic-plastic response, with the published numbers.

Chopra, Dynamics of Structures, 5th edition, Examples 5.5 and 16.4. Data and the digits beyond those
of the book: the tests of structdyn (github.com/learnstructure/structdyn, tests/test_sdf.py and
tests/test_mdf.py), another program with a Newton-Raphson iteration in every step.
"""

import numpy as np
import pytest

import pmalpha as pm

DT = 0.1
TRAPEZOIDAL = pm.Newmark()  # constant average acceleration
EVERY = pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])


def half_sine(t):
    """50 kN over 0.6 s, on one dof."""
    return np.array([50e3 * np.sin(np.pi * t / 0.6) if t < 0.6 - 1e-9 else 0.0])


def elastoplastic(share=1.0, role="internal", **options):
    """Example 5.5, or a share of its mass, damper and spring. N, m, s."""
    m, k = 45594.0, 18e5
    c = 2.0 * 0.05 * np.sqrt(k * m)
    spring = pm.Bilinear([0], k=share * k, fy=share * 36e3)
    M, C = np.array([[share * m]]), np.array([[share * c]])
    return pm.Subdomain(M, None, C=C, scheme=TRAPEZOIDAL, **{role: spring}, **options)


def test_chopra_5_5_elastoplastic_system_under_a_half_sine_pulse():
    u = pm.solve(elastoplastic(force=half_sine), dt=DT, t_end=1.0).u[:, 0]
    # its tolerance in structdyn
    assert u[10] == pytest.approx(0.03606328101158249, rel=1e-5)


@EVERY
def test_chopra_5_5_cut_in_two_is_the_same(coupling):
    a = elastoplastic(0.4, force=lambda t: 0.4 * half_sine(t), double_step=False, name="a")
    b = elastoplastic(0.6, force=lambda t: 0.6 * half_sine(t), name="b")
    tie = pm.tie(a, [0], b, [0])
    u = pm.Coupler([a, b], tie, dt=DT, coupling=coupling).run(1.0)["a"].u[:, 0]
    assert u[10] == pytest.approx(0.03606328101158249, rel=1e-5)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
def test_one_evaluation_per_step_is_far_off():
    # operator splitting: the tests above are not passed by accident
    once = elastoplastic(role="restoring", force=half_sine)
    u = pm.solve(once, dt=DT, t_end=1.0).u[10, 0]
    assert 0.04 < u < 0.042  # 0.0413


# ---- Example 16.4: five storeys, bilinear, base acceleration of one sine ----------------------

MASS, STIFFNESS, YIELD = 25910.0, 1e7, 125e3


def ground(t):
    """Base acceleration, m/s^2."""
    return 1.93 * np.sin(2.0 * np.pi * t) if t < 1.0 + 1e-9 else 0.0


def frame():
    """M, K and C of the elastic frame, with 5 per cent of damping in every mode."""
    M = MASS * np.eye(5)
    K = STIFFNESS * (2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
    K[4, 4] = STIFFNESS
    omega2, modes = np.linalg.eigh(K / MASS)
    C = MASS * modes @ np.diag(2.0 * 0.05 * np.sqrt(omega2)) @ modes.T
    return M, K, C


# structdyn has the hardening H = 0.05 k of the plastic deformation, beside which the elastic spring
# is in series: the slope after yield is k H / (k + H)
HARDENING = 0.05 / 1.05


def yielding(share=1.0, **options):
    """Example 16.4, or a share of its masses, dampers and storeys."""
    M, _, C = frame()
    pairs = [(i, i - 1) for i in range(5)]
    storeys = pm.Bilinear(pairs, k=share * STIFFNESS, fy=share * YIELD, hardening=HARDENING)
    options["force"] = lambda t: -share * MASS * ground(t) * np.ones(5)
    return pm.Subdomain(
        share * M, None, C=share * C, scheme=TRAPEZOIDAL, internal=storeys, **options
    )


def test_chopra_16_4_bilinear_frame_under_a_full_sine_of_the_ground():
    u = pm.solve(yielding(), dt=DT, t_end=2.0).u
    # eight digits are published
    assert u[20, 4] == pytest.approx(0.03998638459760687, rel=1e-7)


@EVERY
def test_chopra_16_4_in_two_frames_tied_at_every_floor_is_the_same(coupling):
    a = yielding(0.3, double_step=False, name="a")
    b = yielding(0.7, name="b")
    tie = pm.tie(a, range(5), b, range(5))
    u = pm.Coupler([a, b], tie, dt=DT, coupling=coupling).run(2.0)["b"].u
    # "macro" to its tolerance, 10 times 1e-8 of the motion in energy, over 20 steps
    assert u[20, 4] == pytest.approx(0.03998638459760687, rel=1e-5)
