"""Impulses of contacts that are summed between recorded time levels, over runs in pieces.

A ball of mass m on the ground under its weight: the sum of all impulses P is m (v - v0 + g t), by
Newton's law, however the run is divided and recorded.
"""

import numpy as np
import pytest

import pmalpha as pm

MASS, G, DT, V0 = 1.5, 10.0, 0.01, -1.0
ROUNDING = 1e-11  # of sums of 200 numbers up to 40


def ball():
    s = pm.Subdomain(
        [MASS], [0.0], scheme=pm.Newmark(), force=[-MASS * G], u0=[0.3], v0=[V0], name="ball"
    )
    return pm.Coupler([s], pm.contact(s, 0, restitution=0.8), dt=DT)


def total(history):
    return history.contacts[0].impulse.sum()


def expected(history):
    """Up to the last recorded time level."""
    s = history["ball"]
    return MASS * (s.v[-1, 0] - V0 + G * s.t[-1])


def pieces(rng):
    """Lengths of runs, in macro steps, 200 together."""
    lengths = rng.integers(15, 40, 5)
    return [*lengths, 200 - lengths.sum()]


@pytest.mark.parametrize("every", [None, 3, 7])
def test_joined_runs_have_all_impulses(every):
    rng = np.random.default_rng(0)
    for _ in range(3):
        coupler = ball()
        runs = [coupler.run(steps=n, every=every) for n in pieces(rng)]
        joined = pm.History.join(runs)
        assert expected(joined) > 10.0  # it has hit the ground
        assert abs(total(joined) - expected(joined)) < ROUNDING


@pytest.mark.gate
@pytest.mark.parametrize("every", [None, 3, 7])
def test_an_appended_file_has_all_impulses_at_their_rows(tmp_path, every):
    """As one run has them; the state comes from a checkpoint or a snapshot in between."""
    rng, path = np.random.default_rng(1), tmp_path / "run.h5"
    whole = ball().run(steps=200, every=every)
    assert abs(total(whole) - expected(whole)) < ROUNDING
    coupler = ball()
    for i, n in enumerate(pieces(rng)):
        if i % 2:
            coupler.save(tmp_path / "state.npz")
            coupler = ball()
            coupler.load(tmp_path / "state.npz")
        else:
            snapshot = coupler.snapshot()
            coupler.run(steps=5, every=1)
            coupler.restore(snapshot)
        appended = coupler.run(steps=n, every=every, record_to=path, append=True)
    np.testing.assert_allclose(
        appended.contacts[0].impulse, whole.contacts[0].impulse, rtol=0, atol=ROUNDING
    )


def test_steps_that_are_not_recorded_are_not_in_the_first_row():
    coupler = ball()
    coupler.run(steps=31, every=2)
    coupler.step(100)
    assert coupler.run(steps=10, every=5).contacts[0].impulse[0, 0] == 0.0
