"""Proportional and modal damping in every matrix format, and damping matrices that are refused."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import models, structures

SCHEME = pm.GeneralizedAlpha(0.8)
FORMS = {
    "dense": np.asarray,
    "csr": sp.csr_array,
    "csc_matrix": sp.csc_matrix,
    "coo": sp.coo_array,
    "dia": sp.dia_array,
}
MASSES, SPRINGS = np.array([4e3, 3e3, 3e3, 2e3]), np.array([6e6, 5e6, 5e6, 4e6])
FRAME_M = np.diag(MASSES)
FRAME_K = (
    np.diag(SPRINGS + np.append(SPRINGS[1:], 0.0))
    - np.diag(SPRINGS[1:], 1)
    - np.diag(SPRINGS[1:], -1)
)
C_M, C_K = 0.7, 2e-3
FRAME_C = C_M * FRAME_M + C_K * FRAME_K


def as_array(A, n):
    if A is None:
        return np.zeros((n, n))
    return A.toarray() if sp.issparse(A) else np.diag(A) if A.ndim == 1 else A


@pytest.mark.parametrize("form_m", [*FORMS, "1-D"])
@pytest.mark.parametrize("form_k", FORMS)
def test_rayleigh_damping_is_a_sum_of_matrices_in_every_format(form_m, form_k):
    M = MASSES if form_m == "1-D" else FORMS[form_m](FRAME_M)
    s = pm.Subdomain(M, FORMS[form_k](FRAME_K), rayleigh=(C_M, C_K), scheme=SCHEME)
    # one product and one sum for each entry
    np.testing.assert_allclose(as_array(s.C, 4), FRAME_C, rtol=1e-15)


def test_rayleigh_damping_is_added_to_a_matrix_of_dashpots():
    dashpot = sp.csr_array(([5e3, 5e3, -5e3, -5e3], ([0, 1, 0, 1], [0, 1, 1, 0])), shape=(4, 4))
    s = pm.Subdomain(MASSES, sp.csr_array(FRAME_K), C=dashpot, rayleigh=(C_M, C_K), scheme=SCHEME)
    np.testing.assert_allclose(as_array(s.C, 4), FRAME_C + dashpot.toarray(), rtol=1e-15)


def test_rayleigh_damping_of_zero_matrices_and_zero_coefficients():
    assert pm.Subdomain(MASSES, FRAME_K, rayleigh=(0.0, 0.0), scheme=SCHEME).C is None
    s = pm.Subdomain(MASSES, np.zeros((4, 4)), rayleigh=(0.5, 1.0), scheme=SCHEME)
    np.testing.assert_array_equal(s.C, 0.5 * MASSES)
    with pytest.raises(ValueError, match="read-only"):
        s.C[0] = 1.0


def test_a_mode_under_rayleigh_damping_decays_with_its_ratio():
    squares, shapes = scipy.linalg.eigh(FRAME_K, FRAME_M)
    omega, ratio = np.sqrt(squares[:2]), 0.05
    c_m, c_k = models.rayleigh(omega, [ratio, ratio])
    M, K = models.shear_frame(MASSES, SPRINGS)
    s = pm.Subdomain(
        M, K, rayleigh=(c_m, c_k), scheme=pm.Newmark(), u0=shapes[:, 0], v0=np.zeros(4)
    )
    period = 2.0 * np.pi / (omega[0] * np.sqrt(1.0 - ratio**2))
    history = pm.solve(s, dt=period / 400, t_end=5.0 * period)
    # after five damped periods exp(-zeta omega t); period error of 2e-5 at 400 steps per period
    expected = np.exp(-ratio * omega[0] * 5.0 * period) * shapes[:, 0]
    np.testing.assert_allclose(history.u[-1], expected, rtol=1e-3)


@pytest.mark.parametrize(
    "wrong, error, words",
    [
        (0.1, TypeError, r"rayleigh must be a pair \(c_m, c_k\), got 0.1"),
        ((0.1,), TypeError, "rayleigh must be a pair"),
        ((0.1, -1e-3), ValueError, r"rayleigh\[1\] must be finite and at least 0, got -0.001"),
        ((np.inf, 0.0), ValueError, r"rayleigh\[0\] must be finite"),
        (("a", 0.0), TypeError, r"rayleigh\[0\] must be a real number, got 'a'"),
    ],
)
def test_rayleigh_refuses_what_is_not_two_coefficients(wrong, error, words):
    with pytest.raises(error, match=words):
        pm.Subdomain(MASSES, FRAME_K, rayleigh=wrong, scheme=SCHEME)


# ---- what the models and `reduce` return --------------------------------------------------------


def made_by_models():
    mesh = dict(E=30e9, nu=0.2, rho=2500.0, mass="lumped")
    plate = structures.plate(3, 2, 0.5, t=0.3, **mesh)
    solid = structures.solid(2, 1, 1, 0.5, **mesh)
    frame = structures.beam_frame(
        [[0, 0], [0, 3]], [[0, 1]], EA=1e9, EI=1e7, rhoA=100.0, mass="lumped", rotary=0.01
    )
    rod = structures.rod(4, 2.0, EA=3.0, rhoA=12.0, mass="lumped")
    chain = structures.chain(4, 2.0, 5.0)
    each = dict(plate=plate, solid=solid, frame=frame, rod=rod, chain=chain)
    made = {name: (s.M, s.K) for name, s in each.items()}
    made["shear_frame"] = models.shear_frame(MASSES, SPRINGS)
    for form in FORMS:
        held = pm.reduce(MASSES, FORMS[form](FRAME_K), fixed=[0])
        made[f"reduce {form}"] = held.M, held.K
    held = pm.reduce(MASSES, SPRINGS, fixed=[1])
    return made | {"reduce 1-D": (held.M, held.K)}


@pytest.mark.parametrize("name", list(made_by_models()))
def test_what_models_return_adds_and_multiplies_as_matrices(name):
    M, K = made_by_models()[name]
    n = K.shape[0]
    assert M.shape == (n, n)
    C = C_M * M + C_K * K
    masses, stiffness = as_array(M, n), as_array(K, n)
    assert np.count_nonzero(masses - np.diag(np.diag(masses))) == 0
    np.testing.assert_allclose(as_array(C, n), C_M * masses + C_K * stiffness, rtol=1e-15)
    np.testing.assert_array_equal(M @ np.arange(n), masses.diagonal() * np.arange(n))


def test_the_roof_of_a_damped_frame_moves_as_in_closed_form():
    # the frame of four storeys of issue 13: static deflection of the roof under a constant force
    M, K = models.shear_frame([1e3] * 4, [1e6] * 4)
    load = np.array([0.0, 0.0, 0.0, 1200.0])
    s = pm.Subdomain(M, K, C=50.0 * M + 0.01 * K, scheme=SCHEME, force=load)
    # four springs in series; the damping ratio of the first mode is 1.36, so it has died out
    assert pm.solve(s, dt=0.05, t_end=40.0).u[-1, 3] == pytest.approx(4 * 1200.0 / 1e6, rel=1e-6)


# ---- a damping matrix that NumPy has broadcast ---------------------------------------------------


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array], ids=["dense", "sparse"])
@pytest.mark.parametrize("masses", [np.full(4, 2e3), MASSES], ids=["equal", "unequal"])
def test_a_mass_added_to_every_row_is_refused_with_the_reason(form, masses):
    K = form(FRAME_K)
    with pytest.raises(ValueError, match=r"C must .*NumPy adds a 1-D M .*rayleigh=\(c_m, c_k\)"):
        pm.Subdomain(masses, K, C=C_M * masses + C_K * K, scheme=SCHEME)


def test_a_mass_added_to_every_row_of_a_diagonal_stiffness_is_refused():
    K = sp.diags_array([1.0, 2.0, 3.0]).tocsr()
    with pytest.raises(ValueError, match="got 0.5 added"):
        pm.Subdomain(np.ones(3), K, C=0.5 * np.ones(3) + 0.1 * K, scheme=SCHEME)


def test_a_full_damping_matrix_of_another_kind_is_accepted():
    rng = np.random.default_rng(3)
    C = 1e3 * rng.normal(size=(4, 4))
    C = C @ C.T
    assert pm.Subdomain(MASSES, FRAME_K, C=C, scheme=SCHEME).C.shape == (4, 4)
    # two dofs: any C with equal diagonal entries is a K + b, so none is refused
    two = np.array([[2.0, -1.0], [-1.0, 2.0]])
    assert pm.Subdomain([1.0, 1.0], two, C=two + 0.3, scheme=SCHEME).C[0, 1] == -0.7
    # gyroscopic terms are refused as such
    skew = np.diag([1.0, -1.0, 1.0], 1) - np.diag([1.0, -1.0, 1.0], -1)
    with pytest.raises(ValueError, match="gyroscopic"):
        pm.Subdomain(MASSES, FRAME_K, C=skew, scheme=SCHEME)


def test_a_dense_damping_matrix_beside_a_sparse_or_diagonal_stiffness_is_warned_of():
    C = 1e3 * (np.ones((4, 4)) + np.diag([1.0, 2.0, 3.0, 4.0]))
    for K, kind in ((sp.csr_array(FRAME_K), "sparse"), (SPRINGS, "diagonal")):
        with pytest.warns(pm.PerformanceWarning, match=f"C is dense and K is {kind}"):
            pm.Subdomain(MASSES, K, C=C, scheme=SCHEME)
        pm.Subdomain(MASSES, K, C=sp.csr_array(C), scheme=SCHEME)  # no warning: it is meant
        pm.Subdomain(MASSES, K, C=np.diag([1.0, 0.0, 2.0, 0.0]), scheme=SCHEME)  # a diagonal


# ---- modal damping -----------------------------------------------------------------------------


def damped_ratios(M, K, C):
    """Damping ratios of the poles of the first-order system, by frequency."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles = np.linalg.eigvals(A)
    poles = poles[poles.imag > 0.0]
    poles = poles[np.argsort(np.abs(poles))]
    return -poles.real / np.abs(poles)


@pytest.mark.parametrize("form", [np.asarray, sp.csr_array], ids=["dense", "sparse"])
def test_modal_damping_gives_each_mode_its_ratio(form):
    ratios = [0.02, 0.05, 0.01]
    C = models.modal_damping(MASSES, form(FRAME_K), ratios)
    assert sp.issparse(C) == (form is sp.csr_array)
    found = damped_ratios(FRAME_M, FRAME_K, as_array(C, 4))
    np.testing.assert_allclose(found, [*ratios, 0.0], atol=1e-12)  # the fourth is undamped
    pm.Subdomain(MASSES, form(FRAME_K), C=C, scheme=SCHEME)  # without a warning


def test_modal_damping_with_one_ratio_damps_all_modes():
    C = models.modal_damping(sp.diags_array(MASSES), FRAME_K, 0.03)
    np.testing.assert_allclose(damped_ratios(FRAME_M, FRAME_K, C), 0.03, rtol=1e-10)


def test_modal_damping_leaves_rigid_motions_and_massless_dofs_free():
    chain = structures.chain(3, [2.0, 1.0, 0.0], [8.0, 8.0])
    C = models.modal_damping(chain.M, chain.K, 0.1).toarray()
    # dof 2 moves with dof 1; two masses on a spring: omega^2 = k (1/m1 + 1/m2) = 12
    reduced = np.array([1.0, -1.0]) * np.sqrt(2.0 / 3.0)  # M x, with x^T M x = 1
    expected = np.zeros((3, 3))
    expected[:2, :2] = 2.0 * 0.1 * np.sqrt(12.0) * np.outer(reduced, reduced)
    np.testing.assert_allclose(C, expected, atol=1e-12)


@pytest.mark.parametrize(
    "ratios, error, words",
    [
        ([0.05, -0.01], ValueError, "ratios must not be negative, got -0.01 at mode 1"),
        ([0.05] * 5, ValueError, "ratios must be at most 4, .* got 5"),
        ([], ValueError, "ratios must not be empty"),
        ("5 %", TypeError, "ratios must hold real numbers"),
    ],
)
def test_modal_damping_refuses_what_is_not_a_ratio(ratios, error, words):
    with pytest.raises(error, match=words):
        models.modal_damping(MASSES, FRAME_K, ratios)


# ---- by ratios and periods ---------------------------------------------------------------------


def test_damping_ratios_at_two_periods_are_those_of_the_modes():
    M, K = models.shear_frame([1.0, 1.0], [3.0, 2.0])  # omega = 1, sqrt(6)
    periods = 2.0 * np.pi / np.array([1.0, np.sqrt(6.0)])
    frame = pm.Subdomain(M, K, scheme=SCHEME, damping_ratio=dict(zip(periods, (0.05, 0.08))))
    omega, x = pm.structures.modes(M, K, 2)
    damping = np.diag(x.T @ frame.C @ x) / (2.0 * omega)
    np.testing.assert_allclose(damping, [0.05, 0.08], rtol=1e-12)  # rounding of two systems
    assert frame.rayleigh == pytest.approx(models.rayleigh([1.0, np.sqrt(6.0)], [0.05, 0.08]))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (0.05, TypeError, r"dict of two periods with their damping ratios, such as \{1.2: 0.05"),
        ({1.0: 0.05}, TypeError, "dict of two periods"),
        ({1.0: 0.05, -1.0: 0.05}, ValueError, "a period must be positive, got -1.0"),
        ({1.0: 5.0, 0.1: 5.0}, ValueError, "damping_ratio must be below 1.*5 per cent is 0.05"),
        ({1.0: 0.05, 0.1: -0.1}, ValueError, "a ratio must be finite and at least 0, got -0.1"),
        ({1.0: 0.0, 0.9: 0.5}, ValueError, "c_m, c_k >= 0, got .*: c_m = -"),
    ],
)
def test_damping_ratios_that_are_none_are_refused(given, error, message):
    with pytest.raises(error, match=message):
        pm.Subdomain([1.0], [1.0], scheme=SCHEME, damping_ratio=given)


def test_damping_is_given_in_one_form_and_divided_by_cut():
    with pytest.raises(TypeError, match="rayleigh must not be given with damping_ratio"):
        pm.Subdomain([1.0], [1.0], scheme=SCHEME, rayleigh=(0.1, 0.1), damping_ratio={1: 0, 2: 0})
    rod = pm.structures.rod(2, 1.0, EA=1.0, rhoA=1.0)
    cut = pm.cut(rod, [0, 1], damping_ratio={2.0: 0.05, 0.2: 0.05})
    whole = pm.Subdomain(rod.M, rod.K, scheme=SCHEME, damping_ratio={2.0: 0.05, 0.2: 0.05})
    assert [s.rayleigh for s in cut.subdomains] == [whole.rayleigh] * 2
