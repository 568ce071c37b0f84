"""Masses and effective masses that cannot be factored are named with subdomain and dof."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import EXPLICIT, PAIR, chain, plate, refused, subdomain

import pmalpha as pm

# ---- mass and Mbar ------------------------------------------------------------------------------


@pytest.mark.parametrize("form", [np.diag, np.asarray, sp.csr_array])
def test_an_explicit_dof_without_mass_is_named(form):
    M = np.diag([1.0, 0.0, 2.0, 0.0])
    M = np.diag(M).copy() if form is np.diag else form(M)
    message = refused(
        pm.FactorizationError,
        lambda: subdomain(M, np.ones(4), scheme=EXPLICIT, name="rig"),
        "'rig'",
        "mass",
    )
    assert "1, 3" in message


@pytest.mark.parametrize("n", [2, 150, 300])  # dense and Lanczos way to the critical step
@pytest.mark.parametrize("M", [[[1.0, 1.0], [1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]]])
@pytest.mark.parametrize("form", [sp.csr_array, sp.csr_array.toarray])
def test_an_explicit_mass_singular_in_another_way_is_a_factorization_error(n, M, form):
    whole = sp.csr_array(sp.block_diag([np.array(M), sp.eye_array(n - 2)]))
    rig = subdomain(form(whole), chain(n), scheme=EXPLICIT, name="rig")
    refused(pm.FactorizationError, lambda: pm.Coupler([rig], dt=0.01), "'rig'", "dof 1")


@pytest.mark.parametrize("form", [np.diag, np.asarray, sp.csr_array])
def test_a_negative_mass_is_a_value_error_with_its_dof(form):
    M = np.diag([1.0, 1.0, -2.0])
    M = np.diag(M).copy() if form is np.diag else form(M)
    refused(ValueError, lambda: subdomain(M, np.ones(3)), "M", "semidefinite", "dof 2")


def test_a_massless_dof_that_is_coupled_by_mass_is_a_value_error():
    M = np.array([[1.0, 0.5], [0.5, 0.0]])
    for form in (np.asarray, sp.csr_array):
        refused(ValueError, lambda: subdomain(form(M)), "M", "semidefinite", "dof 1")


def indefinite(form):
    K = np.diag([4.0, 4.0, -2e4])
    if form == "diagonal":
        return np.diag(K).copy()
    K[0, 1] = K[1, 0] = -1.0
    return K if form == "dense" else sp.csr_array(K)


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.5), pm.Newmark(), pm.HHT(0.1)])
def test_an_indefinite_mbar_is_named_with_subdomain_and_dof(form, scheme):
    # Mbar = M + al1 K, al1 about dt^2 / 4 and more: 1 - 0.25 * 2e4 < 0 at dof 2, positive elsewhere
    bad = subdomain(np.ones(3), indefinite(form), scheme=scheme, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=1.0), "Mbar", "'bad'", "dof 2")
    with pytest.warns(pm.StabilityWarning, match="the motion itself grows"):
        pm.Coupler([bad], dt=1e-3)  # definite at that dof: the step makes it indefinite


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
def test_negative_damping_that_makes_an_explicit_mbar_indefinite_is_named(form):
    bad = subdomain(np.ones(3), np.ones(3), indefinite(form), scheme=EXPLICIT, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=1.0), "M + al2 C", "'bad'", "dof 2")


@pytest.mark.parametrize("form", ["diagonal", "dense", "sparse"])
def test_a_singular_mbar_is_named_with_subdomain_and_dof(form):
    K = np.zeros((3, 3))
    K[0, 0] = 1.0
    if form != "diagonal":
        K[:2, :2] = [[2.0, -1.0], [-1.0, 2.0]]
    shape = {"diagonal": np.diag, "dense": np.asarray, "sparse": sp.csr_array}[form]
    bad = subdomain(np.zeros(3), shape(K), name="bad")
    message = refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.1), "'bad'", "dof")
    assert ("dof 1" if form == "diagonal" else "dof 2") in message


def test_mbar_of_nothing_but_zeros_is_singular():
    bad = subdomain(np.zeros(2), np.zeros(2), name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.1), "'bad'", "singular", "dof 0")


FLOATING = {f"net of {m} x {m}": plate(m) for m in (2, 5, 20, 40, 60)}
FLOATING |= {f"chain of {n}": chain(n, fixed=False) for n in (2, 3, 50, 1000)}
SMALL = [name for name, K in FLOATING.items() if K.shape[0] <= 1000]  # dense ones take time


def check_floating(K, scale):
    bad = subdomain(np.zeros(K.shape[0]), scale * K, name="bad")
    refused(pm.FactorizationError, lambda: pm.Coupler([bad], dt=0.013), "'bad'", "dof")


@pytest.mark.parametrize("name", FLOATING)
@pytest.mark.parametrize("scale", [1.0, 3.7e9])
def test_a_floating_sparse_subdomain_without_mass_is_singular(name, scale):
    check_floating(FLOATING[name], scale)


@pytest.mark.gate
@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("scale", [1.0, 3.7e9])
def test_a_floating_dense_subdomain_without_mass_is_singular(name, scale):
    check_floating(FLOATING[name].toarray(), scale)


def test_a_supported_subdomain_without_mass_is_accepted():
    held = subdomain(np.zeros(1600), plate(40, fixed=True), name="held")
    pm.Coupler([held], dt=0.013)


def test_a_mbar_that_is_nearly_singular_but_definite_is_accepted():
    # a spring to ground of 1e-6 of the others: condition number 1e6 n^2, 8 digits are left
    K = chain(50, fixed=False).tolil()
    K[0, 0] += 1e-6
    pm.Coupler([subdomain(np.zeros(50), sp.csr_array(K))], dt=0.1)


@pytest.mark.parametrize("M", [[1.7e308], [[1.7e308]]])
def test_a_pivot_whose_reciprocal_is_denormal_is_refused(M):
    # the core takes denormal numbers as zero, and forces would not move it
    s = pm.Subdomain(M, [1.0], scheme=pm.CentralDifference())
    with pytest.raises(pm.FactorizationError, match=r"must have pivots of at most 4.49e307"):
        pm.Coupler([s], dt=0.1)


def test_a_pivot_whose_reciprocal_overflows_is_refused():
    # 1 / 5e-324 is infinite: no step could be made
    tiny = subdomain([5e-324], [0.0], name="tiny")
    with pytest.raises((pm.FactorizationError, ValueError)) as caught:
        pm.Coupler([tiny], dt=0.1)
    assert "'tiny'" in str(caught.value)


# ---- massless dofs ------------------------------------------------------------------------------


UNDAMPED = {
    "rho = 1": pm.GeneralizedAlpha(1.0),
    "trapezoidal": pm.Newmark(),
    "HHT(0)": pm.HHT(0.0),
    "WBZ(0)": pm.WBZ(0.0),
}


@pytest.mark.parametrize("kind", UNDAMPED)
def test_a_massless_dof_is_refused_where_nothing_damps_it(kind):
    message = refused(
        ValueError,
        lambda: subdomain([1.0, 0.0], PAIR, scheme=UNDAMPED[kind], name="frame"),
        "scheme must damp",
        "dof 1",
        "'frame'",
    )
    assert repr(UNDAMPED[kind]) in message


@pytest.mark.parametrize("kind", UNDAMPED)
def test_both_ways_that_a_refused_massless_dof_is_offered_give_the_motion(kind):
    K = np.array([[100.0, -70.0], [-70.0, 70.0]])  # ground - 30 - dof 0 - 70 - dof 1
    given = {"u0": [0.7, 1.0], "name": "frame"}
    message = refused(
        ValueError,
        lambda: subdomain([0.0, 2.0], K, scheme=UNDAMPED[kind], **given),
        "take GeneralizedAlpha(0.999)",
        f".reduced(keep, modes=0, scheme={UNDAMPED[kind]!r})",
    )
    assert "dof 0" in message
    damped = subdomain([0.0, 2.0], K, scheme=pm.GeneralizedAlpha(0.999), **given)
    condensed, _ = damped.reduced([1], modes=0, scheme=UNDAMPED[kind])
    assert condensed.scheme == UNDAMPED[kind]
    # 30 and 70 in series are 21
    np.testing.assert_allclose([condensed.M.item(), condensed.K.item()], [2.0, 21.0], rtol=1e-14)
    exact = pm.solve(condensed, dt=0.1, steps=200)
    damped = pm.solve(damped, dt=0.1, steps=200)
    # periods of rho and of 1 differ by e^2 (omega h)^2 of themselves at most, and damping is of
    # e^3: e = (1 - rho) / (1 + rho), omega^2 = 10.5, for 20 omega radians
    most = (0.001 / 1.999) ** 2 * 0.105 * 20.0 * np.sqrt(10.5)
    np.testing.assert_allclose(damped.u[:, 1:], exact.u, rtol=0, atol=most)
    np.testing.assert_allclose(damped.u[:, :1], 0.7 * exact.u, rtol=0, atol=most)


def test_massless_dofs_are_accepted_with_rho_below_one():
    for rho in (0.0, 0.5, 0.99):
        subdomain([1.0, 0.0], PAIR, scheme=pm.GeneralizedAlpha(rho))
