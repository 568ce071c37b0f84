"""Forces that are evaluated once in a step and are too stiff for it are warned of, with the step
that would do; and the sums of energy of double steps go along their chains."""

import math
import re
import warnings

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.setup.stability import critical_damping_product, predicted_product

STIFF = "evaluated once in a step are too stiff for it"
CD, RHO_E = pm.CentralDifference(), pm.GeneralizedAlpha(0.8, explicit=True)
RULE, RHO, RHO_0 = pm.Newmark(), pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.0)
SCHEMES = [CD, RHO_E, RULE, RHO, RHO_0]
H, M = 0.01, 2.0


def motion(x):
    """u and v of the arguments of a function, whatever their order."""
    return x[-2:] if np.ndim(x[0]) == 0 else x[:2]


def force(k=0.0, c=0.0, n=1):
    def evaluate(*x):
        u, v = motion(x)
        return k * u + c * v

    return evaluate


def mass(scheme, h=H, spring=None, n=1, **options):
    part = pm.Subdomain(
        np.full(n, M),
        None if spring is None else np.full(n, spring),
        scheme=scheme,
        v0=np.linspace(0.5, 1.0, n),
        name="m",
        **options,
    )
    with warnings.catch_warnings():  # of critical steps, of which set-up knows
        warnings.simplefilter("ignore", pm.StabilityWarning)
        return pm.Coupler([part], dt=h)


def told(coupler, steps=400):
    """The warning of a run, or None; any other is an error."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            coupler.run(steps=steps)
        except pm.InstabilityError as error:
            return error.cause
    texts = [str(x.message) for x in seen]
    assert len(texts) <= 1, texts
    return texts[0] if texts else None


def steps_of(text):
    """The ratio, and the steps that would do, of a warning."""
    ratio = float(re.search(r"is ([\d.e+-]+) times", text)[1])
    found = re.search(r"at most ([\d.e+-]+)(?: if they are of springs and ([\d.e+-]+) if)?", text)
    return ratio, [float(x) for x in found.groups() if x]


@pytest.mark.parametrize("spring", [None, 3e3])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_stiff_function_is_warned_of_with_the_step_that_would_do(scheme, spring):
    """Explicit: h sqrt((k + K)/m) = Omega_s. Implicit: k alone, but for what K adds where rho < 1,
    less than a fifth here. With that step there is no warning, with five per cent more there is."""
    limit = predicted_product(scheme)
    k = M * (1.3 * limit / H) ** 2
    text = told(mass(scheme, spring=spring, restoring=force(k)))
    ratio, (step, *_) = steps_of(text)
    assert STIFF in text and "larger restoring_stiffness" in text
    exact = 1.3 * math.sqrt(1.0 + (spring or 0.0) / k) if scheme.explicit else 1.3
    rtol = 5e-3 if spring is None or scheme.explicit or scheme is RULE else 0.02  # three digits
    np.testing.assert_allclose((ratio, step), (exact, H / exact), rtol=rtol)
    assert told(mass(scheme, 0.97 * step, spring=spring, restoring=force(k))) is None
    assert STIFF in told(mass(scheme, 1.05 * step, spring=spring, restoring=force(k)))


@pytest.mark.parametrize("kind", ["restoring", "force"])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_stiff_dashpot_and_a_controller_are_warned_of_with_the_step_that_would_do(scheme, kind):
    """c h / m = Z_s, that of lagged damping, (C2)."""
    c = 1.5 * M * critical_damping_product(scheme) / H
    if kind == "force":

        def give(t, u, v):
            return -c * v

        options = {"force": give}
    else:
        options = {"restoring": force(c=c)}
    text = told(mass(scheme, spring=200.0, **options))
    _, steps = steps_of(text)
    assert len(steps) == 2
    np.testing.assert_allclose(steps[1], H / 1.5, rtol=0.02)
    assert told(mass(scheme, 0.97 * steps[1], spring=200.0, **options)) is None
    assert told(mass(scheme, 1.1 * steps[1], spring=200.0, **options))


@pytest.mark.parametrize("share", [0.5, 0.99])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_forces_that_the_step_resolves_are_silent(scheme, share):
    k = M * (share * predicted_product(scheme) / H) ** 2
    c = share * M * critical_damping_product(scheme) / H
    for f in (force(k), force(c=c)):
        assert told(mass(scheme, restoring=f)) is None
    assert told(mass(scheme, spring=50.0, force=lambda t, u, v: -k * u)) is None


def test_an_estimate_that_is_too_low_is_warned_of():
    """Stable up to k = K_r + 4 m / h^2: sqrt(4 (k h^2 / m - K_r h^2 / m)) = 2 x 1.2."""
    K_r = 3.0 * M / H**2
    k = K_r + 1.44 * 4.0 * M / H**2
    text = told(mass(RULE, restoring=force(k), restoring_stiffness=[K_r]))
    np.testing.assert_allclose(steps_of(text)[0], 1.2, rtol=5e-3)
    assert told(mass(RULE, restoring=force(k), restoring_stiffness=[k])) is None


@pytest.mark.parametrize(
    ("coupling", "doubles"),
    [("gc", False), ("pm", False), ("pm", True), ("macro", False), ("macro", True)],
)
def test_a_stiff_force_in_a_part_of_a_cut_structure_is_warned_of(coupling, doubles):
    """Also in double steps, of which it is twice the step that counts."""
    k = M * (2.6 / H) ** 2
    a = pm.Subdomain(
        [M, M],
        [[500.0, -500.0], [-500.0, 500.0]],
        scheme=RULE,
        v0=[1.0, 0.0],
        restoring=lambda *x: k * motion(x)[0] * [0.0, 1.0],
        double_step=doubles,
        name="a",
    )
    b = pm.Subdomain([M], [500.0], scheme=RULE, v0=[1.0], substeps=2, name="b")
    with warnings.catch_warnings():  # of functions under macro coupling
        warnings.simplefilter("ignore", pm.StabilityWarning)
        coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=H, coupling=coupling)
    text = told(coupler, 60)
    assert STIFF in text and "subdomain 'a'" in text
    assert ("(a double step)" in text) == doubles
    np.testing.assert_allclose(steps_of(text)[0], 2.6 if doubles else 1.3, rtol=0.02)


def test_springs_of_cases_side_by_side_are_warned_of():
    """Those cases that move."""
    coupler = mass(CD, restoring=pm.CubicSpring([0], M * (2.2 / H) ** 2, 0.0))
    cases = [{"v0": {"m": [v]}} for v in (0.0, 0.0, 1.0, 0.0)]
    with pytest.warns(pm.StabilityWarning, match="is 1.1 times") as seen:
        coupler.run_each(cases, steps=20)
    assert len(seen) == 1


def test_functions_that_are_iterated_are_not_taken_for_ones_that_are_evaluated_once():
    k = M * (20.0 / H) ** 2

    def give(*x):
        return k * motion([y for y in x if np.size(y) or np.ndim(y) == 0][:3])[0], [[k]]

    assert told(mass(RULE, internal=pm.CubicSpring([0], k, 0.0))) is None
    both = mass(RULE, internal=pm.CubicSpring([0], k, 0.0), restoring=force(M * (2.5 / H) ** 2))
    assert STIFF in told(both)


# ---- double steps --------------------------------------------------------------------------------


@pytest.mark.parametrize("substeps", [1, 2, 4])
def test_the_gain_of_double_steps_is_that_of_the_formulas_along_both_chains(substeps):
    """(B8) to (B10) from n - 1 to n + 1; both begin with single steps."""
    k, gap, spring = 1845.0, 0.08, 11.6
    a = pm.Subdomain(
        [1.0],
        [spring],
        scheme=RULE,
        v0=[1.0],
        name="a",
        substeps=substeps,
        double_step=True,
        internal=pm.Gap([0], k=k, gap=gap),
    )
    b = pm.Subdomain([0.2], [2.5], scheme=RULE, v0=[1.0], substeps=substeps, name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1 * substeps, coupling="pm")
    with pytest.warns(pm.StabilityWarning, match="have added energy"):
        x = coupler.run(steps=48 // substeps)["a"]
    u, v, w = (y[:, 0] for y in (x.u, x.v, x.a))
    r, E = k * np.maximum(u - gap, 0.0), 0.5 * k * np.maximum(u - gap, 0.0) ** 2
    T, count = 0.5 * v**2, np.arange(u.size)
    origin = np.where(count > substeps, count - 2, count - 1)  # single ones in the first macro step
    W, R, gross = (np.zeros(u.size) for _ in range(3))
    for n, o in enumerate(origin[1:], 1):
        du = u[n] - u[o]
        work = 0.5 * (r[n] + r[o]) * du
        W[n], R[n] = W[o] + work, R[o] + 0.5 * (w[n] + w[o]) * du
        gross[n] = gross[o] + abs(work)
    A = np.minimum(-W, E - E[0] - W) - np.maximum(0.0, R - (T - T[0]))
    macro = slice(None, None, substeps)
    A, T, gross, U = A[macro], T[macro], gross[macro], 0.5 * spring * u[macro] ** 2
    fastest = (1.0 - 1e-9) * np.maximum.accumulate(T) <= T
    added = np.where(fastest & (A > 0.01 * gross), A, 0.0).max()
    got, energy, _ = coupler._session.members[0].core.gain
    np.testing.assert_allclose(got, added, rtol=1e-9)
    assert added > 0.1 * (T + U)[fastest].max() and energy > 0.0


@pytest.mark.parametrize("forces", [{"internal": 1.0}, {"restoring": 1.0}], ids=str)
@pytest.mark.parametrize("u0", [-1.0, -2.0])
def test_springs_that_are_displaced_at_the_start_are_warned_of_where_they_grow(forces, u0):
    """Of springs the energy is known: what they held at the start is no gain. They grow as the step
    is half of the period."""
    period = 7.416 / abs(u0)  # of a mass 1 on u^3, over its amplitude
    ((kind, _),) = forces.items()
    told_of = []
    for share in (0.02, 0.4):
        part = pm.Subdomain(
            [1.0],
            [0.0],
            scheme=RULE,
            u0=[u0],
            name="a",
            **{kind: pm.CubicSpring([0], k=0.01, k3=1.0)},
        )
        with warnings.catch_warnings():  # of the step at the start
            warnings.simplefilter("ignore", pm.StabilityWarning)
            coupler = pm.Coupler([part], dt=share * period)
        told_of.append(told(coupler, 300))
    assert told_of[0] is None and told_of[1] is not None


def test_double_steps_that_go_on_from_a_restored_state_are_watched():
    a = pm.Subdomain(
        [1.0], [11.6], scheme=RULE, v0=[1.0], name="a", internal=pm.Gap([0], k=1845.0, gap=0.08)
    )
    b = pm.Subdomain([0.2], [2.5], scheme=RULE, v0=[1.0], name="b")
    coupler = pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=0.1, coupling="pm")
    assert coupler._session.members[0].double
    coupler.step(2)
    snapshot = coupler.snapshot()
    with pytest.warns(pm.StabilityWarning, match="have added energy"):
        coupler.step(100)
    coupler.restore(snapshot)
    assert coupler._session.members[0].core.gain == (0.0, 0.0, 0.0)
    coupler._session.members[0].reported = False
    with pytest.warns(pm.StabilityWarning, match="have added energy"):
        coupler.step(100)
