"""Numbers near the ends of the range of doubles: an error that names the argument, or a result."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import pairwise

import pmalpha as pm

EXTREME = [1e155, 1e200, 1.7e308, 1e-155, 5e-324, np.longdouble("1e4000")]
FORMS = {
    "diagonal": lambda x: np.array([x, x]),
    "dense": lambda x: np.array([[x, -x / 4], [-x / 4, x]]),
    "sparse": lambda x: sp.csr_array([[x, -x / 4], [-x / 4, x]]),
}
SCHEMES = {"implicit": pm.Newmark(), "explicit": pm.GeneralizedAlpha(0.5, explicit=True)}


def result(dt=0.1, scheme="implicit", form="diagonal", coupling="pm", force=None, **numbers):
    """A run of two subdomains with energies, or the error that one of our checks raised."""
    try:
        matrices = {name: FORMS[form](x) for name, x in numbers.items()}
        matrices = {"M": np.ones(2), "K": np.ones(2)} | matrices
        load = None if force is None else np.full(2, force)
        a = pm.Subdomain(**matrices, scheme=SCHEMES[scheme], force=load, v0=[0.0, 1.0], name="a")
        b = pm.Subdomain(np.ones(2), np.ones(2), scheme=pm.Newmark(), name="b")
        coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=dt, coupling=coupling)
        return repr(coupler), coupler.run(steps=3, energy=True), pm.analysis.critical_step(a)
    except (ValueError, pm.PmalphaError) as error:
        return error


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("x", EXTREME)
@pytest.mark.parametrize("name", ["M", "K", "C", "dt", "force"])
def test_no_warning_of_numpy_and_no_error_from_inside(name, x):
    # warnings are errors here: those of NumPy would be raised
    for scheme, coupling, form in pairwise([*SCHEMES], ["pm", "macro", "mean"], [*FORMS]):
        result(scheme=scheme, form=form, coupling=coupling, **{name: x})


def test_a_step_whose_square_is_infinite_is_refused_by_name():
    with pytest.raises(ValueError, match="dt must have a finite square, got 1e\\+155"):
        pm.Coupler([pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())], dt=1e155)


@pytest.mark.parametrize(
    "make, text",
    [
        (lambda: pm.Bilinear([0], k=5e-324, fy=1.0), "fy must be k times a deformation"),
        (lambda: pm.BoucWen([0], k=1.0, fy=5e-324), "fy must be k times a deformation"),
        (lambda: pm.structures.rod(2, 1.0, EA=1.7e308, rhoA=1.0), "EA must lie in 1e-50..1e"),
        (lambda: pm.structures.rod(2, 5e-324, EA=1.0, rhoA=1.0), "length must lie in 1e-50..1e"),
        (lambda: pm.structures.plate(2, 2, 1e300, E=1.0, nu=0.3, rho=1.0), "h must lie in 1e-50"),
        (lambda: pm.models.shear_frame([np.longdouble("1e4000")], [1.0]), "masses must be finite"),
        (
            lambda: pm.Subdomain([1.0], [1e200], scheme=pm.Newmark(), rayleigh=(0.0, 1e200)),
            "rayleigh must give a finite",
        ),
    ],
)
def test_what_leaves_the_range_is_refused_where_it_is_given(make, text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=text):
            make()
