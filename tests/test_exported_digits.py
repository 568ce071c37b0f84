"""Modes and couplers of matrices with tiny masses, or with the ten digits of exported files."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures


def ten_digits(A):
    A = sp.csr_array(A + A.T) * 0.5
    A.data = np.array([float(f"{x:.9e}") for x in A.data])
    return A


@pytest.mark.parametrize("n", [50, 300])  # dense, ARPACK
@pytest.mark.parametrize("tiny", [1e-18, 1e-12, 1e-6])
def test_a_chain_with_a_tiny_mass_has_the_frequencies_of_the_chain_without_it(n, tiny):
    masses = np.ones(n)
    masses[25] = tiny
    chain = structures.chain(n, masses, 1.0, ground=(1.0, 0.0))
    omegas, X = structures.modes(masses, chain.K, 5)
    # without mass 25 follows: two springs in series instead
    rest = np.delete(np.arange(n), 25)
    K = chain.K.toarray()
    condensed = K[np.ix_(rest, rest)] - np.outer(K[rest, 25], K[25, rest]) / K[25, 25]
    expected = np.sqrt(scipy.linalg.eigh(condensed, eigvals_only=True)[:5])
    # the share of the mass is tiny omega^2 / k; rounding of 1 / omega^2 up to 4e4
    np.testing.assert_allclose(omegas, expected, rtol=max(1e-9, tiny))
    np.testing.assert_allclose(X.T @ (masses[:, None] * X), np.eye(5), atol=1e-10)


@pytest.mark.parametrize("members", [10, 120])  # dense, ARPACK
def test_a_frame_with_a_tiny_rotary_inertia_has_the_frequencies_of_one_without(members):
    def beam(rotary):
        x = np.linspace(0.0, 5.0, members + 1)
        nodes = np.column_stack([x, np.zeros(members + 1)])
        lines = np.column_stack([np.arange(members), np.arange(1, members + 1)])
        return structures.beam_frame(
            nodes, lines, EA=1e5, EI=3.0, rhoA=2.0, mass="lumped", rotary=rotary
        )

    frame = beam(1e-12)
    held = frame.dofs(0)
    omegas, _ = structures.modes(frame.M, frame.K, 3, fixed=held)
    # a clamped beam: 1.875^2, 4.694^2, 7.855^2 times sqrt(EI / rhoA) / L^2
    expected = np.array([3.51602, 22.0345, 61.6972]) * np.sqrt(1.5) / 25.0
    # lumped mass: the error is of order (k h)^2, below 1 % and 0.01 % of the third
    np.testing.assert_allclose(omegas, expected, rtol=0.06 if members == 10 else 5e-4)
    without = beam(0.0)
    np.testing.assert_allclose(
        omegas, structures.modes(without.M, without.K, 3, fixed=held)[0], rtol=1e-5
    )


@pytest.mark.parametrize("nx", [4, 30])  # dense, ARPACK
def test_a_floating_plate_of_ten_digits_has_its_modes_and_a_warning_at_most(nx):
    plate = structures.plate(nx, 4, 0.1, E=2e11, nu=0.3, rho=7850.0, t=0.01)
    K = ten_digits(plate.K)
    shift = sp.diags_array(-3e-11 * K.diagonal())  # indefinite for certain
    expected, _ = structures.modes(plate.M, plate.K, 8)
    with pytest.warns(UserWarning, match="omega.2 = -.* of the terms of x.T K x, is taken as 0"):
        omegas, _ = structures.modes(plate.M, K + shift, 8)
    assert omegas[0] == 0.0
    # the elastic ones: 1e-10 of |K| against omega^2, which is 1e-5 of it for the longer plate
    np.testing.assert_allclose(omegas[3:], expected[3:], rtol=1e-4)


def test_a_stiffness_that_is_indefinite_beyond_its_digits_is_refused():
    plate = structures.plate(4, 4, 0.1, E=2e11, nu=0.3, rho=7850.0, t=0.01)
    K = plate.K - sp.diags_array(1e-7 * plate.K.diagonal())
    with pytest.raises(ValueError, match="K must be positive semidefinite, got omega.2 = -"):
        structures.modes(plate.M, K, 4)


# ---- couplers -----------------------------------------------------------------------------------


def indefinite(share, n=6):
    """A chain whose consistent mass has an eigenvalue of -share times its largest entry."""
    chain = structures.rod(n - 1, 1.0, EA=1.0, rhoA=1.0)
    M = chain.M.toarray()
    values, X = np.linalg.eigh(M)
    lowest = X[:, 0]
    M -= (values[0] + share * np.max(M)) * np.outer(lowest, lowest)
    return (M + M.T) / 2.0, chain.K.toarray() + 0.1 * np.eye(n)


def test_a_mass_that_is_indefinite_in_its_last_digits_runs_implicitly_with_a_warning():
    M, K = indefinite(3e-13)
    assert -4e-13 < np.linalg.eigvalsh(M)[0] / np.max(M) < -2e-13
    scheme = pm.GeneralizedAlpha(0.5)
    s = pm.Subdomain(M, K, rayleigh=(0.0, 1.0), scheme=scheme, force=np.ones(6), name="export")
    with pytest.warns(pm.ConstraintWarning, match="M of subdomain 'export' is .* 1e-12 of its la"):
        history = pm.solve(s, dt=0.5, t_end=200.0)
    # damped by a third of the critical value it ends at rest in static equilibrium
    np.testing.assert_allclose(history.u[-1], np.linalg.solve(K, np.ones(6)), rtol=1e-6)


def test_a_mass_that_is_indefinite_by_more_or_explicit_is_refused():
    M, K = indefinite(1e-7)
    for scheme, matrix in (
        (pm.GeneralizedAlpha(0.5), M),
        (pm.CentralDifference(), indefinite(3e-13)[0]),
    ):
        s = pm.Subdomain(matrix, K, scheme=scheme)
        with pytest.raises(pm.FactorizationError, match="not positive definite"):
            pm.Coupler([s], dt=1e-3)


def test_a_negative_diagonal_entry_is_accepted_within_the_digits_where_the_scheme_damps():
    K = np.array([[2.0, -1.0], [-1.0, 1.0]])
    M = np.array([1.0, -3e-13])
    damping = pm.GeneralizedAlpha(0.5)
    s = pm.Subdomain(M, K, scheme=damping, force=[1.0, 0.0], name="s")
    with pytest.warns(pm.ConstraintWarning, match="1e-12 of its largest"):
        history = pm.solve(s, dt=0.01, t_end=5.0)
    # the second dof follows: one mass on a spring of 1; error of order dt^2 t
    expected = np.column_stack([1.0 - np.cos(history.t)] * 2)
    np.testing.assert_allclose(history.u, expected, atol=1e-3)
    for scheme in (pm.Newmark(), pm.CentralDifference()):
        with pytest.raises(ValueError, match="negative diagonal entry at dof 1: -3e-13"):
            pm.Subdomain(M, K, scheme=scheme)
    with pytest.raises(ValueError, match="negative diagonal entry at dof 1: -3e-09"):
        pm.Subdomain([1.0, -3e-9], K, scheme=damping)
