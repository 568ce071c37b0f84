"""Pictures of the properties of schemes show closed forms."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha import plot

pyplot = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def closed():
    yield
    pyplot.close("all")


def curves(figure):
    return {line.get_label(): line.get_data() for line in figure.axes[0].lines}


def test_the_spectral_radius_goes_from_one_to_rho():
    schemes = {"soft": pm.GeneralizedAlpha(0.3), "trapezoidal": pm.Newmark()}
    shown = curves(plot.scheme_radius(schemes))
    assert list(shown) == ["soft", "trapezoidal"]
    x, soft = shown["soft"]
    assert x[0] == pytest.approx(0.01) and soft[0] == pytest.approx(1.0, abs=1e-4)  # order Omega^4
    assert soft[-1] == pytest.approx(0.3, abs=1e-2)
    assert np.allclose(shown["trapezoidal"][1], 1.0, rtol=0.0, atol=1e-6)  # energy is kept


def test_an_explicit_scheme_becomes_unstable_at_its_limit():
    x, radius = curves(plot.scheme_radius(pm.CentralDifference()))["CentralDifference()"]
    assert np.all(radius[x < 0.99 / np.pi] < 1.0 + 1e-6)  # Omega = 2
    assert np.all(radius[x > 1.01 / np.pi] > 1.0)


def test_period_and_damping_are_those_of_the_trapezoidal_rule():
    x, elongation = curves(plot.scheme_period([pm.Newmark()]))[repr(pm.Newmark())]
    Omega = 2.0 * np.pi * x
    exact = Omega / (2.0 * np.arctan(Omega / 2.0)) - 1.0
    assert np.allclose(elongation, exact, rtol=0.0, atol=1e-9)
    _, damping = curves(plot.scheme_damping({"rule": pm.Newmark()}))["rule"]
    assert np.abs(damping).max() < 1e-9


def test_what_is_no_scheme_is_refused():
    for schemes, error in ((3, TypeError), ([3], TypeError), ([], ValueError)):
        with pytest.raises(error):
            plot.scheme_radius(schemes)
    with pytest.raises(ValueError, match="xi must be below 1"):
        plot.scheme_period(pm.Newmark(), xi=1.0)
