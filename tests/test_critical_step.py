"""A step above the critical one of a subdomain is warned of at set-up, and none below it."""

import math
import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import (
    EXPLICIT,
    PAIR,
    chain,
    subdomain,
)

import pmalpha as pm


def limit(scheme):
    """Largest stable h omega, in closed form."""
    if isinstance(scheme, pm.GeneralizedAlpha):
        rho = scheme.rho
        return math.sqrt(12 * (1 + rho) * (2 - rho) / (10 - 5 * rho + rho**2))
    return 1.0 / math.sqrt(scheme.gamma / 2.0 - scheme.beta)  # Newmark


CONDITIONAL = [
    *(pm.GeneralizedAlpha(rho, explicit=True) for rho in (0.0, 0.3, 0.5, 0.8, 1.0)),
    pm.CentralDifference(),
    pm.Newmark(beta=0.0, gamma=0.6),
    pm.Newmark(beta=0.1),
    pm.Newmark(beta=1.0 / 6.0),
    pm.Newmark(beta=0.2, gamma=0.55),
]
# The limit comes from a bisection on spectral radii known to 1e-7, the dense frequency from LAPACK.
CLOSE = 1e-6
# Lanczos may stop 1e-4 short of the highest frequency squared and adds 1e-3 for it.
LANCZOS = 2e-3


def oscillators(n):
    """A chain of unit masses and springs, 4 sin^2(n pi / (2 (n + 1))) its highest omega^2."""
    return np.ones(n), chain(n), 2.0 * math.sin(math.pi * n / (2 * (n + 1)))


def bar(n):
    """A bar between walls with consistent mass; the highest mode in closed form."""
    side = np.full(n - 1, 1.0 / 6.0)
    M = sp.csr_array(sp.diags_array([np.full(n, 4.0 / 6.0), side, side], offsets=[0, 1, -1]))
    angle = math.pi * n / (n + 1)
    square = (2 - 2 * math.cos(angle)) / ((4 + 2 * math.cos(angle)) / 6)
    return M, chain(n), math.sqrt(square)


def dense(problem):
    M, K, omega = problem
    return (M if M.ndim == 1 else M.toarray()), K.toarray(), omega


PROBLEMS = {
    "one mass": (oscillators(1), CLOSE),
    "chain of 7": (oscillators(7), CLOSE),
    "chain of 7, dense": (dense(oscillators(7)), CLOSE),
    "bar of 50": (bar(50), CLOSE),
    "bar of 50, dense": (dense(bar(50)), CLOSE),
    "bar of 300, dense": (dense(bar(300)), CLOSE),
    "chain of 201": (oscillators(201), LANCZOS),
    "chain of 3000": (oscillators(3000), LANCZOS),
    "bar of 201": (bar(201), LANCZOS),
    "bar of 2000": (bar(2000), LANCZOS),
    "diagonal": ((np.array([1.0, 2.0, 0.5]), np.array([4.0, 2.0, 8.0]), 4.0), CLOSE),
    "long diagonal": ((np.full(300, 0.5), np.linspace(1.0, 8.0, 300), 4.0), CLOSE),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_step_just_above_the_critical_one_warns_and_one_just_below_does_not(name):
    (M, K, omega), margin = PROBLEMS[name]
    rig = subdomain(M, K, scheme=EXPLICIT, substeps=4, name="rig")
    critical = limit(EXPLICIT) / omega
    pm.Coupler([rig], dt=4 * critical * (1.0 - margin))  # a warning would be an error
    with pytest.warns(pm.StabilityWarning) as caught:
        pm.Coupler([rig], dt=4 * critical * (1.0 + margin))
    (warning,) = caught
    message = str(warning.message)
    assert "'rig'" in message and f"step {critical * (1.0 + margin):g} of" in message
    reported = float(message.split("critical step ")[1].split()[0].rstrip(":(,"))
    # printed with six digits; on the safe side where Lanczos guesses
    assert critical * (1.0 - margin) - 1e-5 * critical < reported < critical * (1.0 + 1e-5)


@pytest.mark.parametrize("scheme", CONDITIONAL, ids=repr)
def test_every_conditionally_stable_scheme_has_its_own_limit(scheme):
    rig = subdomain([1.0], [4.0], scheme=scheme, name="rig")
    critical = limit(scheme) / 2.0
    pm.Coupler([rig], dt=critical * (1.0 - CLOSE))
    with pytest.warns(pm.StabilityWarning, match="'rig'"):
        pm.Coupler([rig], dt=critical * (1.0 + CLOSE))


@pytest.mark.parametrize("scheme", CONDITIONAL, ids=repr)
def test_the_limit_is_where_runs_begin_to_grow(scheme):
    rig = subdomain([1.0], [4.0], scheme=scheme, u0=[1.0])
    critical = limit(scheme) / 2.0
    below = pm.Coupler([rig], dt=0.99 * critical).run(steps=1000)[0].u
    # the largest root has a modulus of at most one; it is 1 percent from a double one, which
    # makes the bounded motion some ten times as large as it begins
    assert np.max(np.abs(below)) < 50.0
    with pytest.warns(pm.StabilityWarning):
        coupler = pm.Coupler([rig], dt=1.02 * critical)
    # 2 per cent above, the largest root has a modulus of 1.15 to 1.49
    assert np.max(np.abs(coupler.run(steps=1000)[0].u[-10:])) > 1e4


@pytest.mark.parametrize("scheme", [pm.GeneralizedAlpha(0.0), pm.Newmark(), pm.HHT(0.3)], ids=repr)
def test_unconditionally_stable_schemes_never_warn(scheme):
    # a larger h^2 K / M than 1 / eps is warned of, since the mass is lost in rounding
    pm.Coupler([subdomain([1.0], [1e9], scheme=scheme)], dt=1e3)


def test_the_row_sum_bound_alone_never_warns():
    # |K| has row sums of 2 + 2, the highest omega^2 is 3: a step between the two is stable
    K = np.array([[2.0, 1.0], [1.0, 2.0]])
    rig = subdomain(K=K, scheme=pm.CentralDifference())
    pm.Coupler([rig], dt=2.0 / math.sqrt(3.0) * (1.0 - CLOSE))
    skewed = subdomain([1.0, 100.0], PAIR, scheme=pm.CentralDifference())
    omega = math.sqrt(max(np.linalg.eigvals(PAIR / np.array([[1.0], [100.0]])).real))
    pm.Coupler([skewed], dt=2.0 / omega * (1.0 - CLOSE))
    with pytest.warns(pm.StabilityWarning):
        pm.Coupler([skewed], dt=2.0 / omega * (1.0 + CLOSE))


def test_one_stiff_pair_hidden_in_a_long_chain_is_found():
    # its mode is nearly orthogonal to a smooth first guess of Lanczos
    K = chain(1001).tolil()
    K[500, 500] += 100.0
    K[501, 501] += 100.0
    K[500, 501] -= 100.0
    K[501, 500] -= 100.0
    omega = math.sqrt(np.linalg.eigvalsh(K.toarray()[480:522, 480:522])[-1])
    rig = subdomain(np.ones(1001), sp.csr_array(K), scheme=pm.CentralDifference())
    pm.Coupler([rig], dt=2.0 / omega * (1.0 - LANCZOS))
    with pytest.warns(pm.StabilityWarning):
        pm.Coupler([rig], dt=2.0 / omega * (1.0 + LANCZOS))


def test_the_warning_points_at_the_line_that_made_the_coupler():
    rig = subdomain([1.0], [4.0], scheme=EXPLICIT)

    def make():
        return pm.Coupler([rig], dt=2.0)

    with pytest.warns(pm.StabilityWarning) as caught:
        make()
    line = make.__code__.co_firstlineno + 1
    assert [(w.filename, w.lineno) for w in caught] == [(__file__, line)]


def test_the_warning_points_out_of_the_package_where_a_model_made_the_coupler():
    with pytest.warns(pm.StabilityWarning) as caught:
        pm.models.split_oscillator(10.0).coupler(5.0, coupling="pm")
    assert {w.filename for w in caught} == {__file__}


# ---- ties that raise the critical step ----------------------------------------------------------

# A unit mass with omega = 2, critical step 1, tied to a free mass of 3: omega = 1, critical step 2.
ALONE, TIED = 1.0, 2.0


def rig_and_mass(dt, *, tied=True, mass=3.0, substeps=1, coupling="gc", **of_mass):
    rig = subdomain([1.0], [4.0], scheme=pm.CentralDifference(), u0=[1.0], name="rig")
    scheme = pm.Newmark()
    other = subdomain(
        [mass], [0.0], scheme=scheme, substeps=substeps, u0=[1.0], name="mass", **of_mass
    )
    if not tied:
        return pm.Coupler([rig], dt=dt)
    return pm.Coupler([rig, other], pm.tie(rig, 0, other, 0), dt=dt, coupling=coupling)


# close to the critical step the first steps part the tie by as much as the mass moves
@pytest.mark.filterwarnings("ignore:tied displacements:pmalpha.AccuracyWarning")
@pytest.mark.parametrize("coupling", ["gc", "macro", "mean"])
def test_a_step_that_a_tie_makes_stable_is_not_warned_of(coupling):
    with pytest.warns(pm.StabilityWarning, match="'rig' is above its critical step 1:"):
        rig_and_mass(ALONE * (1.0 + CLOSE), tied=False)
    coupler = rig_and_mass(0.99 * TIED, coupling=coupling)  # a warning would be an error
    u = coupler.run(steps=1000)[0].u
    # as in `test_the_limit_is_where_runs_begin_to_grow`
    assert np.max(np.abs(u)) < 50.0
    with pytest.warns(pm.StabilityWarning, match="'rig' is above its critical step 1:"):
        coupler = rig_and_mass(1.02 * TIED, coupling=coupling)
    assert np.max(np.abs(coupler.run(steps=1000)[0].u[-10:])) > 1e4


def test_a_step_that_damping_makes_stable_is_not_warned_of():
    # omega = 2 and a damping ratio of 2; both steps are far above the critical one
    rig = subdomain([1.0], [4.0], [8.0], scheme=EXPLICIT, u0=[1.0], name="rig")
    assert 1.39 > 1.4 * limit(EXPLICIT) / 2.0
    coupler = pm.Coupler([rig], dt=1.39)  # a warning would be an error
    assert np.max(np.abs(coupler.run(steps=2000)[0].u)) < 2.0
    with pytest.warns(pm.StabilityWarning, match="'rig'.*damping, which may raise it"):
        coupler = pm.Coupler([rig], dt=1.41)
    assert np.max(np.abs(coupler.run(steps=2000)[0].u)) > 1e4


def test_steps_that_a_change_elsewhere_makes_grow_are_warned_of():
    coupler = rig_and_mass(1.5)
    # the rig keeps its step of 1.5, which grows beside substeps
    with pytest.warns(pm.StabilityWarning, match="'rig' is above its critical step 1:"):
        coupler.change_steps(substeps={"mass": 2})
    assert np.max(np.abs(coupler.run(steps=500)[0].u[-10:])) > 1e4
    coupler = rig_and_mass(1.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(pm.StabilityWarning, match="'rig'"):
            coupler.change_steps(substeps={"mass": 3})
    with pytest.warns(pm.StabilityWarning, match="'rig'"):  # nothing was kept of the refused one
        coupler.change_steps(substeps={"mass": 3})


@pytest.mark.parametrize(
    "forces",
    [
        dict(restoring=lambda t, u, v: 0.0 * u),
        dict(internal=pm.CubicSpring([0], k=1.0, k3=1.0)),
        dict(force=lambda t, u, v: 0.0 * u),
    ],
    ids=["restoring", "internal", "feedback"],
)
def test_where_forces_are_evaluated_the_subdomain_alone_decides(forces):
    with pytest.warns(pm.StabilityWarning, match="'rig' is above its critical step"):
        rig_and_mass(1.5, **forces)


def test_of_many_dofs_the_subdomain_alone_decides():
    M, K, omega = oscillators(100)
    rig = subdomain(M, K, scheme=pm.CentralDifference(), name="rig")
    masses = subdomain(3.0 * M, 0.0 * M, scheme=pm.Newmark(), name="masses")
    ties = pm.tie(rig, range(100), masses, range(100))
    with pytest.warns(pm.StabilityWarning, match="'rig' is above its critical step"):
        pm.Coupler([rig, masses], ties, dt=3.0 / omega, coupling="gc")  # stable up to 4 / omega
