"""A History at other times, its largest values, and what objects show of themselves."""

import warnings

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.run.study import CaseResult


def tower_and_rig(**options):
    K, names = [[9.0, -4.0], [-4.0, 4.0]], ["first", "roof"]
    how = dict(scheme=pm.Newmark(), v0=[0.0, 1.0], dof_names=names)
    tower = pm.Subdomain([1.0, 2.0], K, name="tower", **how)
    rig = pm.Subdomain([1.0], [400.0], scheme=pm.GeneralizedAlpha(0.8, explicit=True), substeps=5)
    return pm.Coupler([tower, rig], pm.tie(tower, 0, rig, 0), dt=0.02, coupling="macro", **options)


def polynomial(history, c):
    """The same History with u a cubic polynomial of t in all dofs."""
    u = np.polynomial.Polynomial(c)
    subdomains = []
    for s in history.subdomains:
        values = [np.tile(f(s.t)[:, None], s.dofs.size) for f in (u, u.deriv(), u.deriv(2))]
        subdomains.append(pm.SubdomainHistory(s.name, s.t, *values, s.dofs, n=s.n))
    return pm.History(
        tuple(subdomains), history.multipliers, history.multiplier_times, history.velocity_jump,
        history.displacement_jump, history.macro_times, history.keys,
    )  # fmt: skip


def test_between_time_levels_motions_are_exact_for_cubic_polynomials():
    c = [0.3, -1.0, 2.0, 5.0]
    history = polynomial(tower_and_rig().run(1.0), c)
    exact = np.polynomial.Polynomial(c)
    t = np.array([0.0, 0.0137, 0.5, 0.777, 1.0])
    again = history.resampled(t)
    for s in again.subdomains:
        for x, f in ((s.u, exact), (s.v, exact.deriv()), (s.a, exact.deriv(2))):
            np.testing.assert_allclose(x, np.tile(f(t)[:, None], s.dofs.size), rtol=1e-12)
    for k, time in enumerate(t):
        one = history.at(time)
        for i in (0, 1):
            np.testing.assert_array_equal(one[i].u, again[i].u[k])
    assert again.multipliers.shape == (5, 1) and again.velocity_jump.shape == (5, 1)


def test_at_a_time_level_the_recorded_numbers_are_returned():
    history = tower_and_rig().run(1.0, outputs={"tower": {"drift": {"roof": 1, "first": -1}}})
    again = history.resampled(history["tower"].t)
    for name in ("u", "v", "a"):
        np.testing.assert_array_equal(
            getattr(again["tower"], name), getattr(history["tower"], name)
        )
    u = history["tower"].u
    np.testing.assert_allclose(again["tower"].outputs["drift"][:, 0], u[:, 1] - u[:, 0])
    assert history.at(1.0)["tower"]["roof"].u == u[-1, 1]
    assert history.at(1.0 + 1e-12)["tower"][-1].u == u[-1, 1]  # rounding of a time


def test_times_outside_of_the_run_are_refused():
    coupler = tower_and_rig()
    coupler.step(10)
    history = coupler.run(1.0)
    for t in (0.1, 1.1, -1.0):
        with pytest.raises(ValueError, match=r"t must lie in the run, 0.2..1, got"):
            history.at(t)
        with pytest.raises(ValueError, match=r"times must lie in the run, 0.2..1, got"):
            history.resampled(sorted([0.5, t]))
    with pytest.raises(ValueError, match="times must be at least one, in rising order"):
        history.resampled([0.5, 0.4])
    with pytest.raises(TypeError, match="t must be a real number"):
        history.at("end")


def test_peaks_are_the_largest_values_with_their_times():
    history = tower_and_rig().run(2.0)
    peak = history.peak()["tower"]
    u = history["tower"].u
    np.testing.assert_array_equal(peak.u, np.abs(u).max(axis=0))
    at = peak.times["u"][1]
    assert abs(history.at(at)["tower"]["roof"].u) == peak["roof"].u == peak.u[1]


def test_the_motion_of_one_subdomain_is_taken_at_other_times_as_that_of_all():
    history = tower_and_rig().run(1.0)
    tower, t = history["tower"], [0.0, 0.0137, 0.5]
    np.testing.assert_array_equal(tower.resampled(t).u, history.resampled(t)["tower"].u)
    np.testing.assert_array_equal(tower.at(0.0137).v, history.at(0.0137)["tower"].v)
    np.testing.assert_array_equal(tower.peak().times["a"], history.peak()["tower"].times["a"])
    with pytest.raises(ValueError, match=r"t must lie in the run, 0..1, got 1.1"):
        tower.at(1.1)
    k = int(np.argmax(abs(tower["roof"].u)))
    most = f"largest |u| {abs(tower['roof'].u[k]):.4g} at dof roof, largest |v|"
    assert repr(tower.peak()).startswith(f"<Peak of 2 dofs: {most}")
    assert repr(tower.at(tower.t[k])).startswith(f"<State of 2 dofs: {most}")
    assert repr(tower.at(0.0)["roof"]) == "<dof roof: u = 0, v = 1, a = 0>"


def test_subdomains_are_in_a_history_by_name_number_and_object():
    coupler = tower_and_rig()
    history = coupler.run(0.1)
    assert "tower" in history and 1 in history and coupler.subdomains[0] in history
    assert "hall" not in history and 2 not in history and 0.5 not in history
    with pytest.raises(AttributeError, match=r"no 'u'; each subdomain has: history\[name\]\.u"):
        _ = history.u
    with pytest.raises(AttributeError, match="a History has no 'story'$"):
        _ = history.story
    with pytest.raises(TypeError, match="arrays of dofs are u, v and a"):
        _ = history["tower"][:, 0]
    with pytest.raises(TypeError, match="its value must hold real numbers, got None"):
        pm.solve(pm.Subdomain([1, 1], [1, 1], scheme=pm.Newmark(), force=lambda t: None), 0.1, 0.1)


def test_a_history_shows_the_run_in_a_notebook():
    history = tower_and_rig().run(2.0, energy=True)
    shown = history._repr_html_()
    for text in ("t = 0 .. 2", "coupling = &#x27;macro&#x27;", "tower", "subdomain 1", "roof, t ="):
        assert text in shown
    assert "energy: largest" in shown and "warnings" not in shown
    wrong = dict(restoring=lambda t, u, v: -u, name="<wrong>")
    growing = pm.Subdomain([1.0], None, scheme=pm.Newmark(), u0=[1.0], **wrong)
    with pytest.warns(pm.StabilityWarning):
        history = pm.Coupler([growing], dt=0.1).run(4.0)
    assert history.warnings[0].startswith("StabilityWarning: ")
    assert "&lt;wrong&gt;" in history._repr_html_() and "warnings:" in history._repr_html_()


def test_a_run_to_the_present_time_warns_and_keeps_the_run_before():
    coupler = tower_and_rig()
    history = coupler.run(1.0)
    assert coupler.last_history is None
    with pytest.warns(UserWarning, match=r"time is 1 already: nothing is computed\. reset\(\)"):
        again = coupler.run(1.0)
    assert len(again.macro_times) == 1 and coupler.last_history is history
    shown = repr(history)
    del history
    with pytest.warns(UserWarning, match=r"begins again at t = 0; last_history has the run before"):
        coupler.run(1.0)
    assert repr(coupler.last_history) == shown  # kept, however often
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        coupler.run(steps=0)  # which says it
        coupler.run(1.02)
    assert coupler.last_history is None


def test_reset_says_that_it_undoes_changed_steps():
    coupler = tower_and_rig()
    first = coupler.snapshot()
    coupler.change_steps(dt=0.01)
    changed = coupler.snapshot()
    with pytest.warns(UserWarning, match="those of change_steps are undone"):
        coupler.reset()
    assert coupler.dt == 0.02
    coupler.reset()  # no step is changed: no warning
    coupler.restore(changed)
    with pytest.warns(UserWarning, match="those of change_steps are undone"):
        coupler.reset()
    coupler.restore(changed)
    coupler.restore(first)
    coupler.reset()


def test_results_of_cases_show_values():
    assert repr(CaseResult(0.25)) == "<CaseResult 0.25>"
    assert repr(CaseResult(np.arange(3.0))) == "<CaseResult [0. 1. 2.]>"
    assert repr(CaseResult(error=ValueError("too large"))) == (
        "<CaseResult failed, ValueError: too large>"
    )


def test_subdomains_structures_and_cuts_show_themselves_in_a_notebook():
    mass = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="<m>", dof_names=["top"],
                        restoring=pm.Gap(0, 1.0, 0.1), rayleigh=(0.1, 0.0))  # fmt: skip
    shown = mass._repr_html_()
    # the spring is open: 2 pi / sqrt(4)
    for text in ("&lt;m&gt;", "of order 2", "top", "1 spring", "c_m = 0.1", "3.142"):
        assert text in shown
    assert "order 1" in pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(0.4, 0.6))._repr_html_()
    chain = pm.structures.chain(4, 1.0, 2.0)
    assert "3 line" in chain._repr_html_() and "0 .. 3" in chain._repr_html_()
    shown = pm.cut(chain, [0, 0, 1], dt=0.1)._repr_html_()
    assert "Cut into 2 subdomains, 1 constraint" in shown and "part 1" in shown
