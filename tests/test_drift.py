"""AccuracyWarning for macro steps that are too long for the forces at the interface, (D4)."""

import warnings

import interface_survey
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import pmalpha as pm
from pmalpha import structures
from pmalpha.run.drift import LARGE, drift_shares

WIDTH = 0.25  # of the pulse; the wave speed is 1


def cut_bar(per_step, *, every_dof=True, scale=1.0):
    """A free bar of length 2 cut at its middle, at Courant numbers of 0.9 with many substeps.

    Returns the warnings of a run in which a pulse crosses the cut and comes back from the free
    end, and its error relative to the amplitude.
    """
    sizes = 113, 355
    rods = [
        structures.rod(n, 1.0, EA=1.0, rhoA=1.0, mass="lumped", origin=x)
        for n, x in zip(sizes, (-1.0, 0.0))
    ]
    x = np.concatenate([rods[0].points[:, 0], rods[1].points[1:, 0]])
    s = (x + 0.5) / WIDTH
    inside = np.abs(s) < 0.5
    u0 = np.where(inside, np.cos(np.pi * s) ** 4, 0.0)
    v0 = np.where(inside, 4 * np.pi / WIDTH * np.cos(np.pi * s) ** 3 * np.sin(np.pi * s), 0.0)
    dofs = np.arange(114), np.arange(113, 469)
    subdomains = [
        rod.subdomain(
            scheme=pm.CentralDifference(), u0=u0[d], v0=v0[d], substeps=n // per_step, name=name
        )
        for rod, d, n, name in zip(rods, dofs, sizes, ("left", "right"))
    ]
    left, right = subdomains
    one = sp.csr_array(([scale], ([0], [113])), shape=(1, 114))
    other = sp.csr_array(([-scale], ([0], [0])), shape=(1, 356))
    constraint = pm.Constraint({left: one, right: other})
    dt = 0.9 / per_step
    coupler = pm.Coupler(subdomains, constraint, dt=dt, coupling="macro")
    record = None if every_dof else {"left": None, "right": [0]}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        history = coupler.run(steps=int(2.0 * per_step), record=record)
    K, m = np.zeros((469, 469)), np.zeros(469)
    for rod, d in zip(rods, dofs):
        K[np.ix_(d, d)] += rod.K.toarray()
        m[d] += rod.M.diagonal()
    omega2, modes = scipy.linalg.eigh(K, np.diag(m))
    omega = np.sqrt(np.maximum(omega2, 1e-12))
    t = history.macro_times[-1]
    q = (m * u0) @ modes * np.cos(omega * t) + (m * v0) @ modes * np.sin(omega * t) / omega
    error = np.abs(history["left"].u[-1] - (modes @ q)[:114]).max()
    # (D3) is of the steps of the subdomains, near their critical step here
    words = [str(w.message) for w in caught if "macro step" in str(w.message)]
    return words, error, coupler, history


def measure(coupler, history):
    s = coupler._session
    return drift_shares(history, s.members, s.rows, s.loads.motions)


def test_a_macro_step_in_which_the_pulse_passes_is_warned_of():
    words, error, _, _ = cut_bar(4)
    assert error > 0.3
    (message,) = words
    assert message.startswith(
        "the macro step is too long for the forces between 'left' and 'right', which are linear "
        "in it: the displacements in constraint 0 drifted apart by "
    )
    assert message.endswith(" until t = 1.8; take a smaller dt, with fewer substeps")


def test_the_warning_ends_where_the_macro_step_resolves_the_pulse():
    """Of 28 and 56 macro steps in 3.6 widths of the pulse, the latter has an error below 1 %."""
    words, error, coupler, history = cut_bar(28)
    assert len(words) == 1 and 0.03 < error < 0.1 and measure(coupler, history)[0] > LARGE
    words, error, coupler, history = cut_bar(56)
    assert not words and error < 0.01 and measure(coupler, history)[0] < LARGE


def test_the_measure_is_that_of_the_formula():
    _, _, coupler, history = cut_bar(8)
    left, right = coupler._session.keys[0][1], coupler._session.keys[1][1]
    jump = history.displacement_jump[:, 0]
    force = history.multipliers[:, 0].std()
    u = [history[0].u[::14], history[1].u[::44]]
    v = [history[0].v[::14], history[1].v[::44]]
    kinetic = np.mean(v[0] ** 2 @ left.M + v[1] ** 2 @ right.M)
    tied = 0.5 * (u[0][:, 113].std() + u[1][:, 0].std())
    expected = force * np.abs(jump).max() / (kinetic + force * tied)
    np.testing.assert_allclose(measure(coupler, history), [expected], rtol=1e-12)  # sums of 113


def test_a_multiple_of_a_constraint_has_the_same_measure():
    once, scaled = (cut_bar(8, scale=scale) for scale in (1.0, -1e3))
    # the run itself is the same up to rounding, which the explicit steps do not amplify
    np.testing.assert_allclose(measure(*once[2:]), measure(*scaled[2:]), rtol=1e-9)
    assert len(scaled[0]) == 1


def test_a_run_is_judged_by_all_dofs_whatever_is_recorded():
    words, error, coupler, history = cut_bar(4, every_dof=False)
    assert error > 0.3 and words == cut_bar(4)[0]
    assert np.all(measure(coupler, history) == 0.0)  # the record alone does not show it


def halves(**options):
    """Two masses of an oscillator of period 1, many substeps."""
    k = 0.5 * (2.0 * np.pi) ** 2
    scheme = pm.GeneralizedAlpha(0.9)
    a = pm.Subdomain([0.5], [k], scheme=scheme, substeps=40, name="a", **options)
    b = pm.Subdomain([0.5], [k], scheme=scheme, substeps=60, name="b", **options)
    return a, b


def test_a_motion_at_rest_and_a_slow_one_are_not_warned_of():
    """Warnings are errors here. The load varies over 25 periods of 1, dt is a tenth of one."""
    a, b = halves()
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="macro")
    history = coupler.run(steps=20)
    assert np.all(measure(coupler, history) == 0.0)
    a, b = halves(force=lambda t: np.array([1.0 - np.cos(0.04 * 2.0 * np.pi * t)]))
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.1, coupling="macro")
    history = coupler.run(steps=250)
    assert 0.0 < measure(coupler, history)[0] < 0.1 * LARGE


@pytest.mark.parametrize("coupling", ["macro", "mean"])
def test_a_structure_in_its_static_equilibrium_does_not_drift(coupling):
    """The rounding of displacements is no motion, however large a part of it drifts."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        k, loads = 10.0 ** rng.uniform(-1.0, 3.0, 2), rng.normal(size=2)
        a, b = (
            pm.Subdomain(
                [1.0], [ki], scheme=pm.CentralDifference(), substeps=s, force=[F], name=name
            )
            for ki, F, s, name in zip(k, loads, (1, 3), "ab")
        )
        dt = 0.4 / np.sqrt(k.max())
        coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=dt, coupling=coupling)
        coupler.reset(u0=coupler.static())
        history = coupler.run(steps=150)
        assert np.ptp(history["a"].u) < 1e-11 * np.abs(history["a"].u).max()
        assert np.all(measure(coupler, history) == 0.0)


def test_a_prescribed_motion_is_no_drift():
    a = pm.Subdomain(
        [0.5, 0.5], [[4.0, -4.0], [-4.0, 4.0]], scheme=pm.GeneralizedAlpha(0.9), substeps=4
    )
    driven = pm.Constraint({a: [[1.0, 0.0]]}, velocity=lambda t: [np.sin(2.0 * t)])
    coupler = pm.Coupler([a], driven, dt=0.01, coupling="macro")
    history = coupler.run(steps=50)
    assert np.abs(history.displacement_jump).max() > 0.1  # it follows the support
    assert np.all(measure(coupler, history) == 0.0)


def test_other_couplings_are_not_judged():
    a, b = halves(u0=[1.0])
    b = pm.Subdomain(b.M, b.K, scheme=b.scheme, substeps=40, u0=[1.0], name="b")
    for coupling in ("pm", "gc"):
        coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.5, coupling=coupling)
        coupler.run(steps=5)


def test_the_survey_of_the_measure_is_right():
    """The threshold was chosen on other seeds, 0 to 499 and 1000 to 1899."""
    verdicts = []
    for seed in range(7000, 7020):
        found = interface_survey.case(seed)
        if found is not None:
            verdicts.append(interface_survey.accuracy_survey.verdict(*found[:2]))
    assert len(verdicts) > 6
    # (D3) alone, of a load far from resonance, has a false alarm in hundreds
    assert verdicts.count("right") > 4 and verdicts.count("missed") == 0
    assert verdicts.count("false alarm") <= 1
