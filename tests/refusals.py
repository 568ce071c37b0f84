"""Small couplers, what a refused call says, and all numbers of a run, for tests of bad input."""

import math

import numpy as np
import pytest
import scipy.sparse as sp

import pmalpha as pm

IMPLICIT = pm.GeneralizedAlpha(0.5)
EXPLICIT = pm.GeneralizedAlpha(0.5, explicit=True)
PAIR = np.array([[2.0, -1.0], [-1.0, 2.0]])  # two unit masses between walls


def refused(error, call, *words):
    """The message of exactly this error, which must contain all of these words."""
    with pytest.raises(error) as caught:
        call()
    assert type(caught.value) is error, f"{type(caught.value).__name__}: {caught.value}"
    message = str(caught.value)
    for word in words:
        assert word in message, f"no {word!r} in: {message}"
    return message


def subdomain(M=(1.0, 1.0), K=(1.0, 1.0), C=None, *, scheme=IMPLICIT, **options):
    return pm.Subdomain(M, K, C=C, scheme=scheme, **options)


def single(n=1, **options):
    """A chain of n unit masses and springs without couplings."""
    return subdomain(np.ones(n), np.ones(n), **options)


def chain(n, fixed=True):
    """Stiffness of unit springs in a row, between two walls or floating."""
    d = np.full(n, 2.0)
    if not fixed:
        d[[0, -1]] = 1.0
    side = np.full(n - 1, -1.0)
    return sp.csr_array(sp.diags_array([d, side, side], offsets=[0, 1, -1]))


def two_subdomains(**of_a):
    """A coarse and a fine subdomain, tied, with motion in all of their dofs."""
    a = subdomain(K=PAIR, u0=[1.0, 0.5], v0=[0.0, 0.25], name="a", **of_a)
    b = subdomain([1.0], [9.0], scheme=EXPLICIT, substeps=3, u0=[0.5], v0=[0.25], name="b")
    return a, b, pm.tie(a, [1], b, [0])


def coupled(**of_a):
    a, b, tie = two_subdomains(**of_a)
    return pm.Coupler([a, b], tie, dt=0.1, coupling="pm")


def as_bytes(coupler, steps=4):
    """All results of some macro steps and the state at their end, as bytes."""
    history = coupler.run(steps=steps)
    arrays = [getattr(history[i], x) for i in range(len(history)) for x in "tuva"]
    end = [getattr(coupler.state(i), x) for i in range(len(history)) for x in "uva"]
    rest = [history.multipliers, history.velocity_jump, history.displacement_jump]
    return b"".join(x.tobytes() for x in [*arrays, *rest, *end, coupler.multipliers])


def moved(coupler, steps=3):
    coupler.step(steps)
    return coupler


def plate(m, fixed=False):
    """Stiffness of a square net of m x m nodes with unit springs."""
    line, unit = chain(m, fixed), sp.eye_array(m)
    return sp.csr_array(sp.kron(line, unit) + sp.kron(unit, line))


LOADS = {
    "no load": {},
    "a constant": {"force": [0.5, -0.5]},
    "a callable": {"force": lambda t: [math.sin(t), math.cos(t)]},
}
