"""Guyan and Craig-Bampton reduction: closed forms, exact limits, the full problem, bad input."""

import warnings

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from compiled import FORCE
from scipy import LowLevelCallable
from scipy.linalg import expm

import pmalpha as pm
from pmalpha import structures

SCHEME = pm.GeneralizedAlpha(0.8)
STEEL = {"E": 100.0, "nu": 0.3, "rho": 1.0}
FORMATS = {"sparse": lambda A: A, "dense": lambda A: A.toarray()}


def plate(nx=10, ny=3, mass="consistent"):
    """A cantilever, its free dofs, and the dofs of its free edge among them."""
    structure = structures.plate(nx, ny, 1.0, **STEEL, mass=mass)
    held = pm.reduce(structure.M, structure.K, fixed=structure.dofs(structure.nodes_at(x=0.0)))
    edge = held.place(structure.dofs(structure.nodes_at(x=float(nx))))
    return held, edge


def subdomain(held, change=FORMATS["sparse"], **options):
    return pm.Subdomain(change(held.M), change(held.K), scheme=SCHEME, **options)


def by_hand(s, keep, m):
    """T of dense algebra, and the frequencies; the signs of modes are arbitrary."""
    M, K = dense(s.M), dense(s.K)
    others = np.setdiff1d(np.arange(s.n), keep)
    T = np.zeros((s.n, len(keep) + m))
    T[keep, np.arange(len(keep))] = 1.0
    T[others, : len(keep)] = -np.linalg.solve(K[np.ix_(others, others)], K[np.ix_(others, keep)])
    inner = np.ix_(others, others)
    squares, X = scipy.linalg.eigh(K[inner], M[inner])
    T[others, len(keep) :] = X[:, :m]
    return T, np.sqrt(squares[:m])


def dense(A):
    return A.toarray() if sp.issparse(A) else np.diag(A) if A.ndim == 1 else A


# ---- the basis and the matrices -------------------------------------------------------------


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("m", [0, 5])
def test_basis_and_matrices_are_those_of_dense_algebra(format, m):
    held, edge = plate()
    s = subdomain(held, FORMATS[format], rayleigh=(0.1, 0.02), substeps=3, name="plate")
    keep = edge[::-1]
    small, basis = s.reduced(keep, modes=m)
    T, omega = by_hand(s, keep, m)
    T *= np.sign(np.sum(T * basis.matrix, axis=0))
    # rounding of solves with matrices of condition 1e4
    np.testing.assert_allclose(basis.matrix, T, rtol=0, atol=1e-11)
    np.testing.assert_allclose(basis.omega, omega, rtol=1e-10)
    for name in ("M", "C", "K"):
        whole = dense(getattr(s, name))
        np.testing.assert_allclose(
            dense(getattr(small, name)), T.T @ whole @ T, rtol=0, atol=1e-11 * np.abs(whole).max()
        )
    np.testing.assert_array_equal(basis.keep, keep)
    assert (small.substeps, small.name, small.scheme) == (3, "plate", SCHEME)
    assert repr(basis) == f"<ReducedBasis of {s.n} dofs: 8 dofs kept, {counted(m)}>"


def counted(m):
    return "1 mode" if m == 1 else f"{m} modes"


def test_guyan_reduction_of_a_chain_is_one_spring_and_the_mass_of_a_bar():
    n = 9
    chain = structures.chain(n, 1.0, 8.0).subdomain(scheme=SCHEME)
    small, basis = chain.reduced([0, n - 1], modes=0)
    np.testing.assert_allclose(small.K, [[1.0, -1.0], [-1.0, 1.0]], rtol=1e-13)
    x = np.arange(n) / (n - 1)
    np.testing.assert_allclose(basis.matrix, np.column_stack([1 - x, x]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(small.M, [[(1 - x) @ (1 - x), x @ (1 - x)], [x @ (1 - x), x @ x]])


def test_frequencies_up_to_a_limit_are_all_of_them():
    n = 400  # clamped at both ends: 2 sqrt(k/m) sin(i pi / (2 (n - 1)))
    chain = structures.chain(n, 1.0, 1.0).subdomain(scheme=SCHEME)
    i = np.arange(1, n - 1)
    exact = 2.0 * np.sin(i * np.pi / (2 * (n - 1)))
    _, basis = chain.reduced([0, n - 1], omega=exact[19] * (1.0 + 1e-9))
    np.testing.assert_allclose(basis.omega, exact[:20], rtol=1e-9)
    _, basis = chain.reduced([0, n - 1], omega=exact[0] / 2.0)
    assert basis.omega.size == 0
    _, basis = chain.reduced([0, n - 1], omega=3.0)  # above all
    np.testing.assert_allclose(basis.omega, exact, rtol=1e-9)


def test_equal_frequencies_are_all_kept():
    square = structures.plate(16, 16, 1.0, **STEEL)  # symmetric: frequencies in pairs
    rim = square.nodes(lambda x, y: (x == 0) | (x == 16) | (y == 0) | (y == 16))
    s = square.subdomain(scheme=SCHEME)
    _, basis = s.reduced(square.dofs(rim), modes=6)
    _, omega = by_hand(s, square.dofs(rim), 6)
    assert omega[1] / omega[0] - 1.0 < 1e-9  # a pair
    np.testing.assert_allclose(basis.omega, omega, rtol=1e-9)


def test_rigid_motions_keep_their_mass_and_have_no_force():
    structure = structures.plate(6, 4, 1.0, **STEEL)
    keep = structure.dofs(structure.nodes_at(x=0.0))
    small, basis = structure.subdomain(scheme=SCHEME).reduced(keep, modes=2)
    x, y = structure.points.T
    for motion in (np.tile([1.0, 0.0], x.size), np.column_stack([-y, x]).ravel()):
        q = np.append(motion[keep], [0.0, 0.0])
        np.testing.assert_allclose(basis.expand(q), motion, rtol=0, atol=1e-11)
        np.testing.assert_allclose(small.K @ q, 0.0, atol=1e-10)
        assert q @ small.M @ q == pytest.approx(motion @ structure.M @ motion, rel=1e-12)


def test_the_error_of_frequencies_is_positive_and_falls_with_the_number_of_modes():
    held, edge = plate()
    exact = structures.modes(held.M, held.K, 5)[0]
    errors = []
    for m in (0, 2, 5, 10, 20):
        small, _ = subdomain(held).reduced(edge, modes=m)
        errors.append(structures.modes(small.M, small.K, 5)[0] / exact - 1.0)
    errors = np.array(errors)
    assert np.all(errors > -1e-11)  # a smaller space has higher Rayleigh quotients
    assert np.all(np.diff(errors, axis=0) < 1e-11)
    assert errors[0, 4] > 0.1 and errors[4].max() < 1e-3


def test_the_statics_of_forces_on_kept_dofs_are_exact():
    held, edge = plate()
    load = np.zeros(held.free.size)
    load[edge] = np.arange(edge.size) - 2.0
    small, basis = subdomain(held, force=load).reduced(edge, modes=3)
    u = basis.expand(np.linalg.solve(small.K, small.force))
    exact = sp.linalg.spsolve(held.K.tocsc(), load)
    np.testing.assert_allclose(u, exact, rtol=0, atol=1e-10 * abs(exact).max())


# ---- motions --------------------------------------------------------------------------------


def test_with_all_modes_a_coupled_run_is_that_of_the_full_subdomain():
    """Also with another program's idea of it: expm of the coupled structure."""
    held, edge = plate(4, 2)
    n = held.free.size
    rng = np.random.default_rng(2)
    v0 = rng.standard_normal(n)
    full = subdomain(held, v0=v0, name="plate", rayleigh=(0.05, 0.001))
    block = pm.Subdomain([2.0], [3.0], scheme=SCHEME, v0=[v0[edge[0]]], name="block")

    def run(part, dofs):
        tie = pm.tie(part, dofs, block, [0])
        return pm.Coupler([part, block], tie, dt=0.01, coupling="gc").run(1.0)

    small, basis = full.reduced(edge, modes=n - edge.size)
    reduced, whole = run(small, basis.place(edge[:1])), run(full, edge[:1])
    for name in ("u", "v", "a"):
        exact = getattr(whole["plate"], name)
        found = basis.expand(getattr(reduced["plate"], name))
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9 * abs(exact).max())
    np.testing.assert_allclose(reduced.multipliers, whole.multipliers, rtol=0, atol=1e-8)
    # the structure with the block on it
    M, K, C = (dense(A).copy() for A in (full.M, full.K, full.C))
    M[edge[0], edge[0]] += 2.0
    K[edge[0], edge[0]] += 3.0
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    exact = expm(A) @ np.append(np.zeros(n), v0)
    low = (
        structures.modes(sp.csr_array(M), sp.csr_array(K), 1)[1][:, 0] @ M
    )  # the first mode, resolved
    found = basis.expand(reduced["plate"].u[-1])
    assert low @ found == pytest.approx(low @ exact[:n], rel=1e-3)  # dt = 0.01, period about 9


def sampled(n):
    return pm.SampledForce(np.random.default_rng(1).standard_normal((6, n)), 0.1)


FORCES = {
    "constant": lambda n, M: np.linspace(1.0, 2.0, n),
    "function": lambda n, M: lambda t: np.sin(t + np.arange(n)),
    "samples": lambda n, M: sampled(n),
    "shape": lambda n, M: pm.SampledForce([[0.0, 1.0], [2.0, 0.0]], 0.2, np.ones((n, 2))),
    "ground": lambda n, M: pm.BaseAcceleration([0.0, 1.0, -1.0], np.ones(n), M, dt=0.2),
    "none": lambda n, M: None,
}


@pytest.mark.parametrize("kind", FORCES)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_every_force_is_projected(kind, mass):
    held, edge = plate(4, 2, mass)
    s = subdomain(held, force=FORCES[kind](held.free.size, held.M))
    small, basis = s.reduced(edge, modes=4)
    if kind != "none":
        assert type(small.force) is type(s.force) or kind == "function"
    projected = pm.Subdomain(
        dense(small.M),
        dense(small.K),
        scheme=SCHEME,
        force=None if s.force is None else lambda t: basis.matrix.T @ value(s.force, t),
    )
    a, b = (pm.solve(x, 0.05, 1.0).u for x in (small, projected))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
    assert kind == "none" or abs(a).max() > 1e-3


def value(force, t):
    return force(t) if callable(force) else force


def test_initial_values_in_the_space_of_the_basis_are_kept():
    held, edge = plate()
    s = subdomain(held)
    _, basis = s.reduced(edge, modes=4)
    q, p = np.random.default_rng(3).standard_normal((2, basis.matrix.shape[1]))
    moving = subdomain(held, u0=basis.expand(q), v0=basis.expand(p))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        small, _ = moving.reduced(edge, modes=4)
    np.testing.assert_allclose(small.u0, q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(small.v0, p, rtol=0, atol=1e-10)


def test_initial_values_outside_of_the_basis_are_warned_of():
    held, edge = plate()
    v0 = np.zeros(held.free.size)
    v0[0] = 1.0
    with pytest.warns(UserWarning, match=r"v0 is represented by the kept dofs and 2 modes with an"):
        subdomain(held, v0=v0).reduced(edge, modes=2)


@pytest.mark.parametrize("argument", ["restoring", "internal"])
@pytest.mark.parametrize("kind", ["cubic", "gap", "bilinear", "boucwen"])
def test_springs_on_kept_dofs_remain(argument, kind):
    held, edge = plate(4, 2)
    a, b = int(edge[1]), int(edge[3])
    spring = {
        "cubic": lambda at: pm.CubicSpring(at, k=3.0, k3=20.0),
        "gap": lambda at: pm.Gap(at, k=30.0, gap=0.01),
        "bilinear": lambda at: pm.Bilinear(at, k=30.0, fy=0.5, hardening=0.1),
        "boucwen": lambda at: pm.BoucWen(at, k=30.0, fy=0.5, hardening=0.1),
    }[kind]
    load = np.zeros(held.free.size)
    load[b] = 2.0
    s = subdomain(held, force=load, **{argument: [spring([[a, -1]]), spring([[b, a]])]})
    n = s.n
    small, basis = s.reduced(edge, modes=n - edge.size)  # all modes: exact
    whole, found = (pm.solve(x, 0.02, 2.0) for x in (s, small))
    np.testing.assert_allclose(basis.expand(found.u), whole.u, rtol=0, atol=1e-7)
    linear = pm.solve(subdomain(held, force=load), 0.02, 2.0)
    assert abs(linear.u - whole.u).max() > 1e-3
    estimate = small.restoring_stiffness
    assert (estimate is None) == (argument == "internal" or kind == "gap")  # zero at rest


def test_a_given_estimate_of_the_damping_is_kept():
    held, edge = plate(4, 2)
    a = int(edge[1])
    K_r = sp.csr_array(([7.0], ([a], [a])), shape=2 * (held.free.size,))
    s = subdomain(
        held,
        restoring=pm.CubicSpring([[a, -1]], k=3.0, k3=20.0),
        restoring_damping=0.1 * K_r,
    )
    small, basis = s.reduced(edge, modes=2)
    at = int(basis.place(a))
    expected = np.zeros((small.n, small.n))
    expected[at, at] = 7.0
    np.testing.assert_array_equal(dense(small.restoring_damping), 0.1 * expected)
    wide = subdomain(
        held, restoring=pm.CubicSpring([[a, -1]], k=3.0, k3=20.0), restoring_damping=held.K
    )
    with pytest.raises(ValueError, match="keep must have the dofs of restoring_damping"):
        wide.reduced(edge, modes=2)


def test_scheme_substeps_and_name_can_be_changed():
    held, edge = plate(mass="lumped")
    fine = pm.Subdomain(held.M, held.K, scheme=pm.CentralDifference(), substeps=8, name="fine")
    small, _ = fine.reduced(edge, modes=2, scheme=SCHEME, substeps=1, name="small")
    assert (small.scheme, small.substeps, small.name) == (SCHEME, 1, "small")
    same, _ = fine.reduced(edge, modes=2)
    assert (same.scheme, same.substeps, same.name) == (fine.scheme, 8, "fine")
    assert pm.analysis.critical_step(same) > 1.2 * pm.analysis.critical_step(fine)
    with pytest.raises(TypeError, match="changes must be of scheme, .* got 'force'"):
        fine.reduced(edge, modes=2, force=None)


def test_dofs_without_mass_are_condensed_exactly():
    """A massless lever between two masses: a spring."""
    K = np.array([[4.0, -4.0, 0.0], [-4.0, 8.0, -4.0], [0.0, -4.0, 4.0]])
    s = pm.Subdomain([1.0, 0.0, 1.0], K, scheme=SCHEME)
    small, _ = s.reduced([0, 2], modes=0)
    np.testing.assert_allclose(small.K, [[2.0, -2.0], [-2.0, 2.0]], rtol=1e-14)
    np.testing.assert_allclose(dense(small.M), np.eye(2), rtol=0, atol=1e-15)
    with pytest.raises(ValueError, match="modes must be at most 0, got 1"):
        s.reduced([0, 2], modes=1)
    alone = pm.Subdomain(np.zeros(3), K, scheme=SCHEME).reduced([0, 2], modes=0)[0]
    assert alone.massless.tolist() == [0, 1]
    np.testing.assert_allclose(alone.K, [[2.0, -2.0], [-2.0, 2.0]], rtol=1e-14)


def test_all_dofs_can_be_kept_in_another_order():
    K = np.array([[3.0, -1.0], [-1.0, 2.0]])
    s = pm.Subdomain([1.0, 2.0], K, scheme=SCHEME, u0=[5.0, 6.0])
    small, basis = s.reduced([1, 0], modes=0)
    np.testing.assert_allclose(dense(small.K), K[::-1, ::-1], rtol=1e-15)
    assert small.u0.tolist() == [6.0, 5.0] and basis.expand(small.u0).tolist() == [5.0, 6.0]


def test_a_mask_chooses_the_kept_dofs():
    s = structures.chain(4, 1.0, 1.0).subdomain(scheme=SCHEME)
    _, basis = s.reduced(np.array([True, False, False, True]), modes=1)
    assert basis.keep.tolist() == [0, 3]


# ---- bad input ------------------------------------------------------------------------------


def chain(**options):
    return structures.chain(5, 1.0, 1.0).subdomain(scheme=SCHEME, **options)


@pytest.mark.parametrize(
    "options, keep, given, error, message",
    [
        ({}, [0, 5], {"modes": 1}, ValueError, "keep must lie in 0..4, got 5"),
        ({}, [0, 0], {"modes": 1}, ValueError, "keep must not repeat a dof"),
        ({}, [], {"modes": 1}, ValueError, "keep must not be empty"),
        ({}, [0.5], {"modes": 1}, TypeError, "keep must be a 1-D array of whole numbers"),
        ({}, [0], {}, TypeError, "either modes or omega must be given, got modes=None"),
        ({}, [0], {"modes": 1, "omega": 1.0}, TypeError, "either modes or omega must be given"),
        ({}, [0], {"modes": 5}, ValueError, "modes must be at most 4, got 5"),
        ({}, [0], {"modes": -1}, ValueError, "modes must be at least 0, got -1"),
        ({}, [0], {"omega": 0.0}, ValueError, "omega must be positive, got 0.0"),
        ({"restoring": lambda t, u, v: u}, [0], {"modes": 1}, ValueError, "got functions"),
        ({"internal": lambda t, u, v, q: (u, 1)}, [0], {"modes": 1}, ValueError, "got functions"),
        ({"restoring": pm.Gap([2], k=1.0, gap=1.0)}, [0], {"modes": 1}, ValueError, "springs on 2"),
        ({"internal": pm.Gap([2], k=1.0, gap=1.0)}, [0], {"modes": 1}, ValueError, "springs on 2"),
    ],
)
def test_what_does_not_fit_is_refused(options, keep, given, error, message):
    with pytest.raises(error, match=message):
        chain(**options).reduced(keep, **given)


def test_a_subdomain_that_floats_with_the_kept_dofs_fixed_is_refused():
    structure = structures.plate(6, 4, 1.0, **STEEL)
    s = structure.subdomain(scheme=SCHEME)
    for keep in (structure.dofs(0), structure.dofs([0, 34], "ux")):
        with pytest.raises(ValueError, match="keep must hold the subdomain, which floats"):
            s.reduced(keep, modes=0)
    s.reduced(structure.dofs([0, 34]), modes=0)
    with pytest.raises(ValueError, match="K must not be zero for a reduction"):
        pm.Subdomain([1.0], None, scheme=SCHEME, restoring=lambda t, u, v: u).reduced([0], modes=0)


def test_a_compiled_force_is_refused():
    function = FORCE(lambda t, n, f, user: 0)
    with pytest.raises(ValueError, match="force must not be a compiled function for a reduction"):
        chain(force=LowLevelCallable(function)).reduced([0], modes=1)


def test_the_basis_refuses_other_shapes_and_other_dofs():
    _, basis = chain().reduced([0, 4], modes=1)
    with pytest.raises(ValueError, match=r"u must have 3 in the last dimension, .* shape \(2,\)"):
        basis.expand([1.0, 2.0])
    with pytest.raises(ValueError, match="dofs must be kept ones, got 1, 2"):
        basis.place([0, 1, 2])
    assert basis.place([[4, 0]]).tolist() == [[1, 0]]


def test_a_basis_that_does_not_fit_is_refused(monkeypatch, thresholds):
    from pmalpha import memory

    held, edge = plate(100, 20)
    monkeypatch.setattr(memory, "available", lambda: 10_000)
    thresholds(ALLOCATION=0)
    with pytest.raises(MemoryError, match="a basis of 42 static shapes needs about"):
        subdomain(held).reduced(edge, modes=0)
