"""Random sparse matrices, and constraints on some of their dofs, for tests of factors."""

import numpy as np
import scipy.sparse as sp


def definite_matrix(rng, n, density):
    """Symmetric, positive definite, with unconnected blocks where the density is low."""
    A = sp.random_array((n, n), density=density, rng=rng)
    return sp.csr_array(A @ A.T + sp.diags_array(rng.uniform(0.5, 1.5, n)))


def unsymmetric_matrix(rng, n, density):
    """Not symmetric, also in its pattern, with a symmetric part as above."""
    A, B = definite_matrix(rng, n, density), sp.random_array((n, n), density=density, rng=rng)
    return sp.csr_array(A + B - B.T)


def compliance_problem(rng, matrix, densities):
    """A matrix A, an interface (nb,), constraints L (k, nb) on it, none without an entry, and
    L (A^-1)_bb L^T from the dense inverse."""
    n = int(rng.integers(2, 120))
    nb = int(rng.integers(1, n + 1))
    A = matrix(rng, n, rng.choice(densities))
    last = np.sort(rng.choice(n, nb, replace=False))
    L = rng.normal(size=(int(rng.integers(1, nb + 1)), nb)) * (rng.random(nb) < 0.5)
    L[:, 0] = 1.0
    return A, last, L, L @ np.linalg.inv(A.toarray())[np.ix_(last, last)] @ L.T
