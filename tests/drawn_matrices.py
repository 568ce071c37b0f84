"""Random sparse matrices, for tests of factors."""

import scipy.sparse as sp


def definite_matrix(rng, n, density):
    """Symmetric, positive definite, with unconnected blocks where the density is low."""
    A = sp.random_array((n, n), density=density, rng=rng)
    return sp.csr_array(A @ A.T + sp.diags_array(rng.uniform(0.5, 1.5, n)))


def unsymmetric_matrix(rng, n, density):
    """Not symmetric, also in its pattern, with a symmetric part as above."""
    A, B = definite_matrix(rng, n, density), sp.random_array((n, n), density=density, rng=rng)
    return sp.csr_array(A + B - B.T)
