"""Substeps chosen by the local error: section 16 of docs/method.md, (Q5) and (Q6)."""

import numpy as np
import pytest
from agreement import assert_identical

import pmalpha as pm
from pmalpha.run import tolerance

T, DT = 4.0, 0.02


def burst(center, frequency, width):
    def force(t):
        size = 40.0 * np.exp(-(((t - center) / width) ** 2))
        return np.array([0.0, size * np.sin(2.0 * np.pi * frequency * (t - center))])

    return force


PROBLEMS = {
    "burst": dict(force=burst(0.6, 12.0, 0.08)),
    "free": dict(),
    "soft": dict(force=burst(1.0, 6.0, 0.3), soft=0.1),
}


def two(substeps=(1, 1), *, force=None, soft=1.0, explicit=False, coupling="gc", **options):
    """A soft and a stiff subdomain of two dofs, tied; the table of method.md."""
    a, b = pm.GeneralizedAlpha(0.8), pm.GeneralizedAlpha(0.8, explicit=explicit)
    K_A = soft * np.array([[80.0, -40.0], [-40.0, 40.0]])
    K_B = np.array([[900.0, -900.0], [-900.0, 1800.0]])
    A = pm.Subdomain([2.0, 1.0], K_A, scheme=a, substeps=substeps[0], name="A", u0=[0.02, 0.05])
    of_b = dict(substeps=substeps[1], name="B", force=force, u0=[0.05, 0.025])
    B = pm.Subdomain([0.5, 0.3], K_B, scheme=b, **of_b)
    return pm.Coupler([A, B], pm.tie(A, [1], B, [0]), dt=DT, coupling=coupling, **options)


def end(coupler):
    return np.concatenate([coupler.state(k).u for k in "AB"])


@pytest.mark.gate
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_error_is_of_the_size_of_the_tolerance(name):
    """Between 0.05 and 2 times r T over three decades; the table of method.md has 0.08 to 1.7."""
    exact = two((128, 128), **PROBLEMS[name])  # its error is 1e-5, a twentieth of what is allowed
    exact.run(T, record={})
    steps = []
    for r in (0.1, 0.01, 0.001):
        coupler = two(**PROBLEMS[name])
        history = coupler.run(T, tolerance=r)
        error = np.max(np.abs(end(coupler) - end(exact)))
        assert 0.05 * r * T < error < 2.0 * r * T
        assert history.macro_times[-1] == coupler.time == pytest.approx(T, rel=1e-14)
        steps.append(history["A"].t.size + history["B"].t.size)
    assert steps[0] < steps[1] < steps[2]


@pytest.mark.gate
def test_substeps_grow_in_the_burst_and_fall_after_it():
    history = two(**PROBLEMS["burst"]).run(T, tolerance=0.1)
    ss, t = history.substeps, history.macro_times
    assert ss.shape == (t.size, 2)
    assert np.all(np.log2(ss) % 1.0 == 0.0)
    assert ss[t < 0.3].max() < ss[(t > 0.5) & (t < 0.7)].max()
    changes = np.count_nonzero(np.any(np.diff(ss, axis=0), axis=1))
    assert changes < 20  # no chatter: 3 here
    for i, name in enumerate("AB"):
        rows = np.concatenate([[0], np.cumsum(ss[1:, i])])
        assert np.array_equal(history[name].t[rows], t)


@pytest.mark.gate
def test_local_errors_stay_below_four_tolerances():
    """Checked from the recorded motion with (Q5)."""
    r = 0.01
    history = two(**PROBLEMS["burst"]).run(T, tolerance=r)
    for name in "AB":
        s = history[name]
        h = np.diff(s.t)[:, None]
        e = s.u[1:] - (s.u[:-1] + h * s.v[:-1] + h**2 / 6.0 * (2.0 * s.a[:-1] + s.a[1:]))
        assert np.max(np.abs(e) / h) < tolerance.REPEATED * r * (1.0 + 1e-9)


@pytest.mark.gate
def test_a_run_in_two_pieces_is_bitwise_one_run(tmp_path):
    whole = two(**PROBLEMS["burst"]).run(1.0, tolerance=0.02)
    c = two(**PROBLEMS["burst"])
    first = c.run(0.62, tolerance=0.02)
    c.save(tmp_path / "state.npz")
    fresh = two(**PROBLEMS["burst"])
    fresh.load(tmp_path / "state.npz")
    second = fresh.run(1.0, tolerance=0.02)
    joined = pm.History.join([first, second])
    assert_identical(joined, whole)
    assert np.array_equal(joined.substeps[1:], whole.substeps[1:])


@pytest.mark.gate
def test_threads_do_not_change_bits():
    runs = [two(threads=n, **PROBLEMS["burst"]).run(1.0, tolerance=0.02) for n in (1, 2)]
    assert_identical(*runs)


@pytest.mark.gate
def test_what_is_recorded_is_chosen():
    c = two(**PROBLEMS["burst"])
    whole = two(**PROBLEMS["burst"]).run(1.0, tolerance=0.02)
    calls = []
    history = c.run(
        1.0,
        tolerance=0.02,
        record={"B": [1]},
        every=5,
        outputs={"A": {"sum": [1.0, 1.0]}},
        energy=True,
        progress=lambda done, total: calls.append((done, total)),
    )
    assert history["B"].u.shape == (11, 1) and history["A"].u.shape == (11, 0)
    np.testing.assert_array_equal(history.macro_times, whole.macro_times[::5])
    rows = np.concatenate([[0], np.cumsum(whole.substeps[1:, 1])])[::5]
    np.testing.assert_array_equal(history["B"].u[:, 0], whole["B"].u[rows, 1])
    rows = np.concatenate([[0], np.cumsum(whole.substeps[1:, 0])])[::5]
    np.testing.assert_array_equal(history["A"].outputs["sum"][:, 0], whole["A"].u[rows].sum(axis=1))
    assert calls[-1] == (50, 50)
    assert history.energy.kinetic.shape == (11, 2)


def test_works_go_on_over_changes_of_the_substeps():
    """External work of the load on B from the recorded motion, (B2); 1e-12: rounding."""
    force = PROBLEMS["burst"]["force"]
    history = two(**PROBLEMS["burst"]).run(1.0, tolerance=0.02, energy=True)
    s = history["B"]
    F = np.array([force(t) for t in s.t])
    work = np.concatenate(
        [[0.0], np.cumsum(0.5 * np.sum(np.diff(s.u, axis=0) * (F[1:] + F[:-1]), axis=1))]
    )
    rows = np.concatenate([[0], np.cumsum(history.substeps[1:, 1])])
    np.testing.assert_allclose(history.energy.external[:, 1], work[rows], atol=1e-12)


def test_a_file_is_written_at_the_end(tmp_path):
    pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    history = two(**PROBLEMS["burst"]).run(1.0, tolerance=0.02, record_to=path)
    loaded = pm.History.load(path)
    assert_identical(loaded, history)
    assert np.array_equal(loaded.substeps, history.substeps)
    with pytest.raises(FileExistsError):
        two().run(1.0, tolerance=0.02, record_to=path)
    with pytest.raises(ValueError, match="append"):
        two().run(1.0, tolerance=0.02, record_to=path, append=True)


def test_tolerances_by_name_leave_the_others():
    history = two((1, 4), **PROBLEMS["burst"]).run(1.0, tolerance={"A": 0.01})
    assert np.all(history.substeps[:, 1] == 4)
    assert history.substeps[:, 0].max() > 1


def test_other_numbers_become_powers_of_two():
    history = two((3, 6)).run(0.1, tolerance={"A": 1.0})
    assert history.substeps[0].tolist() == [4, 8]


@pytest.mark.gate
def test_explicit_substeps_keep_to_the_critical_step():
    history = two((1, 16), explicit=True).run(T, tolerance=10.0)
    critical = pm.analysis.critical_step(two((1, 16), explicit=True).subdomains[1])
    assert DT / history.substeps[:, 1].min() <= critical
    assert history.substeps[-1, 1] < 16


def test_the_most_substeps_are_reported(thresholds):
    thresholds(MOST_STEPS=8)
    with pytest.warns(pm.AccuracyWarning, match="tolerance was not reached for 'A', 'B'"):
        history = two(**PROBLEMS["burst"]).run(1.0, tolerance=1e-7)
    assert history.substeps.max() == 8


def test_an_exception_leaves_the_last_macro_step():
    calls = PROBLEMS["burst"]["force"]

    def fails(t):
        if t > 0.5:
            raise ZeroDivisionError
        return calls(t)

    c = two(force=fails)
    with pytest.raises(ZeroDivisionError):
        c.run(1.0, tolerance=0.02)
    assert c.last_history.macro_times[-1] == c.time
    np.testing.assert_array_equal(c.last_history["B"].u[-1], c.state("B").u)


@pytest.mark.parametrize("coupling", ["pm", "macro", "mean"])
def test_other_couplings_are_refused(coupling):
    c = two((1, 2), coupling=coupling)
    with pytest.raises(ValueError, match='tolerance needs coupling="gc"'):
        c.run(0.1, tolerance=0.1)
    assert c.step_count == 0


WRONG = [
    (0.0, ValueError),
    (-1.0, ValueError),
    (np.inf, ValueError),
    ("0.1", TypeError),
    ({"C": 0.1}, ValueError),
    ({"A": -0.1}, ValueError),
]


@pytest.mark.parametrize(("value", "kind"), WRONG)
def test_wrong_tolerances_change_nothing(value, kind):
    c = two((3, 6))
    with pytest.raises(kind, match="tolerance"):
        c.run(0.1, tolerance=value)
    assert c.step_count == 0 and c._session.steps.layout.substeps == (3, 6)


def test_restoring_functions_are_refused():
    s = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), restoring=lambda t, u, v: u, name="rig")
    with pytest.raises(ValueError, match="restoring functions"):
        pm.Coupler([s], dt=0.1, coupling="gc").run(1.0, tolerance=0.1)


def test_constant_substeps_are_in_every_history(tmp_path):
    history = two((2, 4)).run(0.1)
    assert history.substeps.tolist() == [[2, 4]] * 6
    history.save(tmp_path / "run.npz")
    assert pm.History.load(tmp_path / "run.npz").substeps.tolist() == [[2, 4]] * 6


@pytest.mark.gate
def test_chosen_substeps_are_drawn():
    pytest.importorskip("matplotlib")
    figure = two(**PROBLEMS["burst"]).run(1.0, tolerance=0.02).plot().figure
    assert [ax.get_ylabel() for ax in figure.axes][-1] == "substeps"
    constant = two().run(0.2).plot()
    assert "substeps" not in [ax.get_ylabel() for ax in constant.figure.axes]
