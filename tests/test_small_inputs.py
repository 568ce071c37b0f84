"""Short ways to write an input mean what the long ways mean; near misses get advice."""

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm
from pmalpha.__main__ import main

SOFT = pm.GeneralizedAlpha(0.5)


def chain(n, name=None, **options):
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    return pm.Subdomain(np.ones(n), K, scheme=SOFT, name=name, **options)


def dense(constraint):
    return [L.toarray().tolist() for L in constraint.matrices.values()]


# ---- dofs ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dofs_a", "dofs_b"),
    [
        (1, 0),
        (np.int32(1), np.array(0)),
        ([1], 0),
        ([False, True, False], [True, False]),
        (np.array([False, True, False]), [0]),
    ],
    ids=str,
)
def test_a_tie_takes_one_number_or_a_mask(dofs_a, dofs_b):
    a, b = chain(3), chain(2)
    assert dense(pm.tie(a, dofs_a, b, dofs_b)) == [[[0.0, 1.0, 0.0]], [[-1.0, 0.0]]]


def test_a_mask_ties_its_dofs_in_their_order():
    a, b = chain(4), chain(3)
    tied = pm.tie(a, [True, False, True, False], b, np.array([False, True, True]))
    assert dense(tied) == [[[1, 0, 0, 0], [0, 0, 1, 0]], [[0, -1, 0], [0, 0, -1]]]


@pytest.mark.parametrize(
    ("dofs", "error", "words"),
    [
        (True, TypeError, "whole numbers"),
        (np.True_, TypeError, "whole numbers"),
        (1.0, TypeError, "whole numbers"),
        ("1", TypeError, "whole numbers"),
        (None, TypeError, "whole numbers"),
        ([[1]], TypeError, "whole numbers"),
        ([0.0], TypeError, "whole numbers"),
        ([None], TypeError, "whole numbers"),
        ({0}, TypeError, "whole numbers"),
        (np.array([0j]), TypeError, "whole numbers"),
        ([[0], [0, 1]], ValueError, "regular array"),
        (3, ValueError, r"0\.\.2, got 3"),
        (-4, ValueError, r"-3\.\.2, got -4"),
        ([True, False], ValueError, r"mask of shape \(3,\), got shape \(2,\)"),
        ([False, False, False], ValueError, "at least one"),
    ],
    ids=str,
)
def test_other_dofs_are_refused(dofs, error, words):
    with pytest.raises(error, match=words):
        pm.tie(chain(3), dofs, chain(2), 0)


@pytest.mark.parametrize("dofs", [2, [2], [False, False, True]], ids=str)
def test_a_run_records_one_dof_or_those_of_a_mask(dofs):
    coupler = pm.Coupler([chain(3, "tower", u0=[0.0, 0.0, 1.0])], dt=0.1)
    history = coupler.run(steps=4, record={"tower": dofs})
    assert history["tower"].dofs.tolist() == [2]
    coupler.reset()
    np.testing.assert_array_equal(history["tower"].u, coupler.run(steps=4)["tower"].u[:, [2]])


def test_one_dof_is_fixed_by_its_number():
    assert pm.reduce(np.ones(3), np.ones(3), fixed=1).free.tolist() == [0, 2]


def test_a_mask_is_placed_in_the_reduced_numbers():
    held = pm.reduce(np.ones(2), np.ones(2), fixed=0)
    assert held.place([False, True]).tolist() == [0]
    with pytest.raises(ValueError, match="must be free, got the fixed ones 0"):
        held.place([True, False])


# ---- one dof ---------------------------------------------------------------------------------


def test_numbers_are_the_matrices_of_one_dof():
    short = pm.Subdomain(2, 8.0, C=0.1, scheme=SOFT, u0=1, v0=np.float64(0.5))
    long = pm.Subdomain([2.0], [8.0], C=[0.1], scheme=SOFT, u0=[1.0], v0=[0.5])
    assert short.n == 1
    u, wanted = (pm.solve(x, dt=0.01, steps=100).u for x in (short, long))
    np.testing.assert_array_equal(u, wanted)
    # m u'' + c u' + k u = 0: omega = 2, xi = c / (2 m omega); error of order (omega h)^2
    omega, xi, t = 2.0, 0.0125, 1.0
    damped = omega * np.sqrt(1.0 - xi**2)
    exact = np.exp(-xi * omega * t) * (
        np.cos(damped * t) + (0.5 + xi * omega) / damped * np.sin(damped * t)
    )
    assert u[-1, 0] == pytest.approx(exact, abs=4e-4)


@pytest.mark.parametrize("K", [4.0, np.array(4.0)])
def test_a_number_is_no_stiffness_of_two_dofs(K):
    with pytest.raises(ValueError, match="K must be of size 2 like M, got one number"):
        pm.Subdomain([1.0, 1.0], K, scheme=SOFT)


@pytest.mark.parametrize("M", [True, 1j, "1", np.nan])
def test_other_single_values_are_no_mass(M):
    with pytest.raises((TypeError, ValueError), match="M must"):
        pm.Subdomain(M, 1.0, scheme=SOFT)


def test_a_number_is_no_initial_displacement_of_two_dofs():
    with pytest.raises(ValueError, match="u0 must be a 1-D array"):
        chain(2, u0=1.0)


# ---- near misses -----------------------------------------------------------------------------

TIMES = np.linspace(0.0, 1.0, 11)


@pytest.mark.parametrize(
    "call",
    [
        lambda: pm.Coupler([chain(1)], dt=TIMES),
        lambda: pm.solve(chain(1), TIMES, 1.0),
        lambda: pm.SampledForce(TIMES, dt=TIMES),
        lambda: pm.BaseAcceleration(TIMES, dt=list(TIMES), direction=[1.0], M=[1.0]),
    ],
)
def test_a_vector_of_times_as_dt_is_named(call):
    words = r"dt must be a real number.*shape \(11,\).*t\[1\] - t\[0\]"
    with pytest.raises(TypeError, match=words):
        call()


@pytest.mark.parametrize(
    ("scheme", "alpha", "advice"),
    [
        (pm.HHT, -0.1, r"HHT\(0\.1\)"),
        (pm.HHT, -1 / 3, r"HHT\(0\.333333\)"),
        (pm.WBZ, -0.25, r"WBZ\(0\.25\)"),
    ],
)
def test_the_other_sign_of_alpha_is_explained(scheme, alpha, advice):
    with pytest.raises(ValueError, match=f"lie in.*opposite sign.*{advice}"):
        scheme(alpha)


@pytest.mark.parametrize("alpha", [-0.4, 0.4, -1e300])
def test_an_alpha_of_neither_sign_gets_no_advice(alpha):
    with pytest.raises(ValueError, match=r"alpha must lie in \[0, 0\.333333\]") as caught:
        pm.HHT(alpha)
    assert "sign" not in str(caught.value)


# ---- what is printed -------------------------------------------------------------------------


def test_constraints_and_loads_print_what_they_are():
    a, b, c = chain(3, "a"), chain(1, "b"), chain(1)
    push = pm.SampledForce([0.0, 1.0], dt=0.5)
    quake = pm.BaseAcceleration(np.ones((11, 2)), np.ones((3, 2)), np.ones(3), dt=0.02)
    shown = {
        pm.tie(a, 0, b, 0): "<1 constraint on 'a' and 'b'>",
        pm.tie(a, [0, 1], chain(2, "d"), [0, 1]): "<2 constraints on 'a' and 'd'>",
        pm.Constraint({a: np.ones((1, 3)), b: [[1.0]], c: sp.csr_array([[2.0]])}): (
            "<1 constraint on 'a', 'b' and 'subdomain of 1 dof'>"
        ),
        pm.Constraint({b: [[1.0]]}, velocity=push): (
            "<1 constraint on 'b', velocity = "
            "<SampledForce on 1 dof: 2 samples, dt = 0.5, to t = 0.5>>"
        ),
        pm.Constraint({b: [[1.0]]}, velocity=[0.25]): "<1 constraint on 'b', velocity = [0.25]>",
        quake: "<BaseAcceleration on 3 dofs: 11 samples of 2 series, dt = 0.02, to t = 0.2>",
        pm.SampledForce([3.0], dt=1.0): "<SampledForce on 1 dof: 1 sample, dt = 1, to t = 0>",
    }
    for thing, words in shown.items():
        assert repr(thing) == words


def test_one_dof_is_singular():
    assert repr(chain(1)).startswith("<Subdomain 1 dof, ")
    assert repr(chain(2)).startswith("<Subdomain 2 dofs, ")


def test_the_command_prints_its_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"pmalpha {pm.__version__}\n"


# ---- what other programs read ----------------------------------------------------------------


@pytest.mark.parametrize("how", ["record_to", "save"])
def test_an_hdf5_file_describes_itself(how, tmp_path):
    h5py = pytest.importorskip("h5py")
    a, b = chain(2, "the tower", restoring=pm.CubicSpring([0], 1.0, 1.0)), chain(1)
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="gc")
    path = tmp_path / "run.h5"
    options = dict(steps=3, energy=True, record_springs={0: None})
    if how == "record_to":
        history = coupler.run(record_to=path, **options)
    else:
        history = coupler.run(**options)
        history.save(path)
    arrays = {}
    with h5py.File(path) as file:
        assert file.attrs["format"] == "pmalpha History"
        assert file.attrs["pmalpha_version"] == pm.__version__
        assert "consistent" in file.attrs["units"]
        for name in ("the tower", "subdomain 1"):
            assert file[name].attrs["name"] == name
        file.visititems(lambda name, x: arrays.update({name: dict(x.attrs)}))
        groups = {name for name in arrays if isinstance(file[name], h5py.Group)}
    assert groups == {"the tower", "subdomain 1", "energy"}
    for name, attributes in arrays.items():
        if name not in groups | {"header"}:
            assert attributes["description"] and attributes["units"], name
    assert arrays["subdomain 1/v"]["units"] == "u/t" and arrays["energy/kinetic"]["units"] == "F u"
    np.testing.assert_array_equal(pm.History.load(path)["the tower"].u, history[0].u)


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "Träger", "x" * 100_000], ids=range(4))
def test_any_name_of_a_subdomain_can_be_written(name, tmp_path):
    pytest.importorskip("h5py")
    pm.Coupler([chain(1, name)], dt=0.1).run(steps=1).save(tmp_path / "run.h5")
    assert pm.History.load(tmp_path / "run.h5")[name].u.shape == (2, 1)


# ---- one dof -------------------------------------------------------------------------------------


def one(force, **options):
    return pm.Subdomain(1.0, 4.0, scheme=SOFT, force=force, name="one", **options)


@pytest.mark.parametrize(
    "force", [2.0, 2, np.float32(2.0), np.array(2.0), lambda t: 2.0, lambda t: np.float64(2.0)]
)
def test_a_load_on_one_dof_is_a_number(force):
    expected = pm.solve(one([2.0]), 0.1, steps=5).u
    assert np.array_equal(pm.solve(one(force), 0.1, steps=5).u, expected)
    coupler = pm.Coupler([one(None)], dt=0.1)
    coupler.reset(force={"one": force})
    assert np.array_equal(coupler.run(steps=5)["one"].u, expected)


def test_initial_values_of_one_dof_are_numbers_in_a_reset_too():
    coupler = pm.Coupler([one(None)], dt=0.1)
    coupler.reset(u0={"one": 1.0}, v0={"one": 2})
    assert np.array_equal(coupler.state("one").u, [1.0])
    assert np.array_equal(coupler.state("one").v, [2.0])


@pytest.mark.parametrize("velocity", [0.5, lambda t: 0.5])
def test_a_prescribed_velocity_of_one_row_is_a_number(velocity):
    s = one(None, v0=0.5)
    coupler = pm.Coupler([s], pm.Constraint({s: [[1.0]]}, velocity=velocity), dt=0.1)
    coupler.step(2)
    np.testing.assert_allclose(coupler.state("one").v, 0.5, rtol=1e-14)  # rounding of a solve


def test_a_restoring_force_of_one_dof_is_a_number():
    options = dict(restoring_stiffness=1.0, u0=1.0)
    short = one(None, restoring=lambda t, u, v: float(u[0]), **options)
    long = one(None, restoring=lambda t, u, v: u, **options)
    ours, theirs = (pm.solve(s, 0.1, steps=5).u for s in (short, long))
    assert np.array_equal(ours, theirs)


@pytest.mark.parametrize("force", [1.0, lambda t: 1.0])
def test_a_number_is_no_load_on_two_dofs(force):
    with pytest.raises(ValueError, match=r"must be a 1-D array, got shape \(\)"):
        pm.solve(chain(2, force=force), 0.1, steps=1)


@pytest.mark.parametrize("force", [True, "1", 1j, np.nan])
def test_a_number_that_is_no_real_one_is_no_load(force):
    with pytest.raises((TypeError, ValueError), match="force must"):
        one(force)


@pytest.mark.parametrize("scheme", [pm.Newmark(), pm.GeneralizedAlpha(0.8)])
def test_a_mass_that_the_step_does_not_see_is_warned_of(scheme):
    # h^2 K / M of the second dof: 1e-4 / m, to be compared with 1 / eps = 4.5e15
    def made(m):
        K = np.array([[2.0, -1.0], [-1.0, 1.0]])
        light = pm.Subdomain([1.0, m], K, scheme=scheme, u0=[1.0, 0.0], name="light")
        return pm.Coupler([light], dt=0.01)

    with pytest.warns(pm.StabilityWarning, match=r"mass at dof 1 of subdomain 'light'.*= 1e\+26"):
        coupler = made(1e-30)
    u = coupler.run(1.0)["light"].u
    assert np.abs(u).max() > 1e6  # the energy is that of u = 1
    made(1e-19)
    if isinstance(scheme, pm.GeneralizedAlpha):
        with pytest.warns(pm.ConstraintWarning, match="dofs without mass"):
            made(0.0)


def test_a_mass_that_the_step_does_not_see_beside_an_internal_force_is_warned_of():
    spring = pm.CubicSpring([0], k=1.0, k3=0.0)  # h^2 k / m = 1e-4 / 1e-30
    light = pm.Subdomain([1e-30], None, scheme=pm.Newmark(), internal=spring, name="light")
    with pytest.warns(pm.StabilityWarning, match=r"mass at dof 0 of subdomain 'light'.*= 1e\+26"):
        pm.Coupler([light], dt=0.01)
