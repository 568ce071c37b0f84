"""Local errors of recorded steps, (D1) of docs/method.md."""

import numpy as np
import pytest

import pmalpha as pm

OMEGA = 2.0


def oscillator(scheme, dt, t_end, **options):
    part = pm.Subdomain([1.0], [OMEGA**2], scheme=scheme, v0=[1.0], name="one")
    return pm.Coupler([part], dt=dt).run(t_end, **options)


def tower_and_rig(dt):
    """The first example of the README as it was, with dt = 0.05."""
    tower = pm.Subdomain(
        [1.0, 2.0, 1.0],
        np.array([[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]]),
        scheme=pm.GeneralizedAlpha(0.8),
        u0=[0.0, 0.0, 0.1],
        name="tower",
    )
    scheme = pm.GeneralizedAlpha(0.8, explicit=True)
    rig = pm.Subdomain([1.0], [4000.0], scheme=scheme, substeps=20, name="rig")
    return pm.Coupler([tower, rig], pm.tie(tower, [0], rig, [0]), dt=dt, coupling="pm")


@pytest.mark.parametrize(
    "scheme, constant", [(pm.Newmark(), 1 / 12), (pm.CentralDifference(), -1 / 6)]
)
def test_the_estimate_is_the_leading_term_of_the_local_error(scheme, constant):
    # u1 - (...) = (beta - 1/6) h^2 (w1 - w) = (beta - 1/6) h^3 u''' + O(h^4)
    h = 1e-3
    history = oscillator(scheme, h, 1.0)["one"]
    middle = history.t[:-1] + h / 2
    third = -(OMEGA**2) * np.cos(OMEGA * middle)  # u = sin(2 t) / 2
    estimate = history.local_error()[:, 0]
    # h^4 terms and the global error of u are 1e-6 of it; rounding is 1e-16 / (constant h^3)
    assert np.allclose(estimate, constant * h**3 * third, rtol=1e-4, atol=2e-15)


def test_the_estimate_has_a_row_for_each_step_and_a_column_for_each_recorded_dof():
    coupler = tower_and_rig(0.005)
    history = coupler.run(1.0, record={"tower": [2, 0], "rig": None})
    assert history["tower"].local_error().shape == (200, 2)
    assert history["rig"].local_error().shape == (4000, 1)


def test_a_double_step_is_estimated_over_two_time_levels():
    history = tower_and_rig(0.005).run(1.0)["tower"]
    e, (u, v, w), h = history.local_error(), (history.u, history.v, history.a), 0.01
    expected = u[2:] - (u[:-2] + h * v[:-2] + h**2 * (2 * w[:-2] + w[2:]) / 6)
    assert np.array_equal(e[1:], expected)
    h = 0.005  # the first step is single
    first = u[1] - (u[0] + h * v[0] + h**2 * (2 * w[0] + w[1]) / 6)
    assert np.array_equal(e[0], first)
    assert (history.substep, history.double_after) == (0.005, 0.005)


def test_the_first_double_step_of_a_continued_run_began_before_the_record():
    coupler = tower_and_rig(0.005)
    coupler.step(50)
    e = coupler.run(1.0)["tower"].local_error()
    assert np.isnan(e[0]).all() and np.isfinite(e[1:]).all()


def test_thinned_records_have_no_local_errors():
    history = tower_and_rig(0.005).run(1.0, every=4)
    with pytest.raises(ValueError, match="all time levels of 'tower'"):
        history["tower"].local_error()


@pytest.mark.parametrize("suffix", ["npz", "h5"])
def test_a_file_keeps_the_lengths_of_the_steps(tmp_path, suffix):
    if suffix == "h5":
        pytest.importorskip("h5py")
    history = tower_and_rig(0.005).run(0.5)
    history.save(tmp_path / f"run.{suffix}")
    again = pm.History.load(tmp_path / f"run.{suffix}")
    for name in ("tower", "rig"):
        assert np.array_equal(again[name].local_error(), history[name].local_error())


def test_a_history_that_is_written_during_the_run_has_local_errors(tmp_path):
    pytest.importorskip("h5py")
    expected = tower_and_rig(0.005).run(0.5)
    history = tower_and_rig(0.005).run(0.5, record_to=tmp_path / "run.h5")
    assert np.array_equal(history["rig"].local_error(), expected["rig"].local_error())


@pytest.mark.parametrize("begin", [0, 1, 2, 5])
@pytest.mark.parametrize("every", [1, 2, 3])
def test_local_errors_need_all_time_levels_wherever_the_run_begins(begin, every):
    one = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[-1.0])
    coupler = pm.Coupler([one], dt=0.01)
    if begin:
        coupler.step(begin)
    motion = coupler.run(steps=12, every=every)[0]
    if every == 1:
        # h^3 / 12 of the third derivative, 4 cos(2 t) of -sin(2 t) / 2: at most 3.4e-7
        assert np.abs(motion.local_error()).max() <= 4.0 * 0.01**3 / 12
        return
    with pytest.raises(ValueError, match="local_error needs all time levels"):
        motion.local_error()
