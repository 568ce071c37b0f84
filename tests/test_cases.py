"""Several load cases in one call: each is bitwise the run after a reset, and nothing remains."""

from itertools import combinations

import numpy as np
import pytest
import waits
from agreement import assert_identical
from test_checkpoint import chain, coupler, snapshot

import pmalpha as pm
from pmalpha.results.quantities import arrays_of

DAMPED = pm.GeneralizedAlpha(0.5)
GROWS = "ignore:.*grows with damping:pmalpha.StabilityWarning"


def one_by_one(c, cases, *arguments, **options):
    histories = []
    for case in cases:
        c.reset(**case)
        histories.append(c.run(*arguments, **options))
    return histories


def random_cases(c, count, seed=0):
    """Loads of all kinds that the core evaluates, displacements and velocities at rest."""
    rng = np.random.default_rng(seed)
    cases = []
    for k in range(count):
        force = {}
        for i, (name, s) in enumerate(c._session.keys):
            values, shape = rng.standard_normal((30, 2)), rng.standard_normal((s.n, 2))
            force[name] = (
                pm.SampledForce(values, 0.07, shape),
                pm.SampledForce(rng.standard_normal((5, s.n)), 0.11),
                rng.standard_normal(s.n),
                None,
                pm.BaseAcceleration(values[:, 0], np.ones(s.n), np.ones(s.n), dt=0.13),
            )[(i + k) % 5]
        cases.append({"force": force})
    return cases


# ---- equal to reset and run ----------------------------------------------------------------------


@pytest.mark.filterwarnings(GROWS)
@pytest.mark.parametrize(
    "coupling, count",
    [("pm", 1), ("gc", 2), ("pm", 20), ("gc", 9), ("macro", 9), ("mean", 20)],
)
def test_each_case_is_bitwise_the_run_after_a_reset(coupling, count):
    substeps = 1 if coupling == "macro" else 4
    ours, theirs = (coupler(coupling=coupling, substeps=substeps) for _ in range(2))
    cases = random_cases(ours, count)
    for x, y in zip(ours.run_each(cases, 1.2), one_by_one(theirs, cases, 1.2), strict=True):
        assert_identical(x, y)


def test_loads_of_many_dofs_are_added_bitwise_in_every_case():
    n, count = 600, 6  # more than the core adds of one case before the next one; 12 cases
    c = pm.Coupler([pm.Subdomain(np.ones(n), np.ones(n), scheme=DAMPED, name="A")], dt=0.05)
    cases = random_cases(c, count)
    shape = np.random.default_rng(2).standard_normal((n, 2))
    cases += [
        {"force": {"A": pm.SampledForce(np.outer(np.arange(9.0), [1.0, k]), 0.07, shape)}}
        for k in range(count)
    ]  # loads of the same times
    for ours, theirs in zip(c.run_each(cases, steps=20), one_by_one(c, cases, steps=20)):
        assert_identical(ours, theirs)


def test_histories_share_no_array_that_can_be_written():
    c = softened()
    histories = c.run_each([{}] * 9, steps=20)
    found = [[x for r in (h, *h.subdomains) for x in arrays_of(r).values()] for h in histories]
    shared = [
        x
        for one, other in combinations(found, 2)
        for x, y in zip(one, other, strict=True)
        if np.shares_memory(x, y)
    ]
    assert len(shared) > 0 and not any(x.flags.writeable for x in shared)


def softened(coupling="pm", **options):
    """Springs of all laws in an explicit and an implicit subdomain."""
    M, K = chain(4)
    laws = [
        pm.Bilinear([(0, 1), (1, 3)], [60.0, 80.0], [0.4, 0.5], 0.1),
        pm.Gap([2], 300.0, 0.01),
        pm.BoucWen([(1, 2), (2, 3)], 50.0, 0.3, n=[1, 3]),
        pm.CubicSpring([0], 10.0, 50.0),
    ]
    a = pm.Subdomain(M, K, scheme=DAMPED, restoring=laws, name="a")
    free = K - 100.0 * np.eye(4)[:, [0]] @ np.eye(4)[[0]]
    b = pm.Subdomain(
        M, free, scheme=pm.CentralDifference(), substeps=4, restoring=laws[:3], name="b"
    )
    return pm.Coupler([a, b], pm.tie(a, [3], b, [0]), dt=0.02, coupling=coupling, **options)


@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_springs_remember_their_own_case(coupling):
    ours, theirs = softened(coupling), softened(coupling)
    rng = np.random.default_rng(1)
    cases = [
        {"v0": {"a": [*rng.standard_normal(3), v], "b": [v, *rng.standard_normal(3)]}}
        for v in rng.standard_normal(11)
    ]
    springs = {"a": None, "b": [0, 2, 4]}
    expected = one_by_one(theirs, cases, steps=40, record_springs=springs)
    found = ours.run_each(cases, steps=40, record_springs=springs)
    for x, y in zip(found, expected, strict=True):
        assert_identical(x, y)
    assert np.ptp(found[0]["a"].force[:, 1]) > 0.1  # they yield


@pytest.mark.parametrize(
    "options",
    [
        {"record": {}},
        {"record": {"a": [4, 1], "c": None}},
        {"every": 3},
        {"energy": True},
        {"record": {"b": []}, "outputs": {"a": {"N": np.arange(6.0)}, "b": {"V": np.ones((2, 6))}}},
        {"outputs": {"c": {"f": {"u": np.eye(6)[:2], "a": np.ones((2, 6))}}}, "every": 2},
    ],
)
def test_what_is_recorded_is_that_of_single_runs(options):
    ours, theirs = coupler(), coupler()
    cases = random_cases(ours, 9)
    expected = one_by_one(theirs, cases, steps=7, **options)
    for x, y in zip(ours.run_each(cases, steps=7, **options), expected, strict=True):
        assert_identical(x, y)


def test_a_prescribed_motion_is_that_of_every_case():
    ours, theirs = coupler(moved=True), coupler(moved=True)
    cases = random_cases(ours, 9)
    expected = one_by_one(theirs, cases, steps=7)
    for x, y in zip(ours.run_each(cases, steps=7), expected, strict=True):
        assert_identical(x, y)


def test_a_callable_load_belongs_to_its_case():
    ours, theirs = coupler(), coupler()
    cases = random_cases(ours, 9)
    for k in (0, 4, 8):
        cases[k]["force"]["b"] = lambda t, k=k: np.full(6, np.sin((k + 1) * t))
    expected = one_by_one(theirs, cases, steps=7)
    for x, y in zip(ours.run_each(cases, steps=7), expected, strict=True):
        assert_identical(x, y)


@pytest.mark.filterwarnings(GROWS)
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro", "mean"])
def test_any_number_of_threads_and_any_grouping_give_bitwise_the_same(coupling):
    cases = random_cases(coupler(), 21)
    substeps = 1 if coupling == "macro" else 4
    whole = coupler(coupling=coupling, substeps=substeps, threads=1).run_each(cases, steps=4)
    for threads, size in ((2, 21), (3, 4), (1, 3)):
        c = coupler(coupling=coupling, substeps=substeps, threads=threads)
        parts = [c.run_each(cases[i : i + size], steps=4) for i in range(0, len(cases), size)]
        for x, y in zip(whole, sum(parts, []), strict=True):
            assert_identical(x, y)


# ---- the coupler itself --------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [0, 6])
@pytest.mark.parametrize("force", [None, lambda t: np.full(6, np.cos(3.0 * t))])
def test_the_coupler_is_as_before_and_its_run_continues_bitwise(steps, force):
    ours, theirs = coupler(force=force), coupler(force=force)
    other = {"force": {"c": np.ones(6)}}
    for c in (ours, theirs):
        c.reset(**other)
        c.step(steps)
    ours.run_each(random_cases(ours, 10), steps=5)
    assert ours.step_count == steps
    assert_identical(ours.run(steps=5), theirs.run(steps=5))
    assert snapshot(ours) == snapshot(theirs)


def test_a_coupler_that_has_not_begun_has_not_begun_afterwards():
    calls = []

    def force(t):
        calls.append(t)
        return np.zeros(6)

    ours = coupler(force=force)
    ours.run_each([{"force": {"a": None}}] * 3, steps=2)
    assert calls == []
    assert ours.step_count == 0
    assert_identical(ours.run(steps=3), coupler(force=force).run(steps=3))


def test_the_last_history_is_kept():
    def breaking(t):
        if t > 0.25:
            raise ZeroDivisionError
        return np.zeros(6)

    ours = coupler(force=breaking)
    with pytest.raises(ZeroDivisionError):
        ours.run(steps=9)
    before = ours.last_history
    ours.run_each([{}] * 2, steps=2)
    assert ours.last_history is before and ours.step_count == before.macro_times.size - 1


# ---- cases that fail -----------------------------------------------------------------------------


@pytest.mark.parametrize("count", [3, 10])
def test_a_case_that_overflows_does_not_end_the_others(count):
    ours, theirs = coupler(), coupler()
    cases = random_cases(ours, count)
    cases[1] = {"force": {"b": np.full(6, 1e308)}}
    with pytest.raises(pm.CasesError, match=rf"1 of {count} cases.*cases\[1\]: Instab") as caught:
        ours.run_each(cases, steps=6)
    error = caught.value
    assert error.failures.keys() == {1} and error.__cause__ is error.failures[1]
    theirs.reset(**cases[1])
    with pytest.raises(pm.InstabilityError) as single:
        theirs.run(steps=6)
    assert str(single.value) == str(error.failures[1])
    assert_identical(error.histories[1], theirs.last_history)
    for k in {*range(count)} - {1}:
        assert_identical(error.histories[k], one_by_one(theirs, [cases[k]], steps=6)[0])
    assert ours.step_count == 0 and ours.last_history is None


def test_an_exception_of_a_load_is_a_failure_of_its_case():
    def breaking(t):
        raise ZeroDivisionError(f"at {t:g}")

    ours = coupler()
    with pytest.raises(pm.CasesError, match="ZeroDivisionError: at 0") as caught:
        ours.run_each([{}, {"force": {"a": breaking}}, {}], steps=2)
    assert [h is None for h in caught.value.histories] == [False, True, False]


def test_ctrl_c_ends_cases_side_by_side():
    ours = coupler(threads=2)
    ours.step(3)
    before = snapshot(ours)
    with pytest.raises(KeyboardInterrupt), waits.ctrl_c_when(lambda: waits.is_stepped(ours), 0.1):
        ours.run_each([{}] * 24, steps=2_000_000_000, record={}, every=1_000_000_000)
    assert snapshot(ours) == before


def test_ctrl_c_ends_all_cases():
    def stop(t):
        raise KeyboardInterrupt

    ours = coupler()
    ours.step(3)
    before = snapshot(ours)
    with pytest.raises(KeyboardInterrupt):
        ours.run_each([{}, {"force": {"a": stop}}, {}], steps=2)
    assert snapshot(ours) == before


# ---- wrong input: nothing begins -----------------------------------------------------------------


@pytest.mark.parametrize(
    "cases, options, error, message",
    [
        ({"force": None}, {}, TypeError, "cases must be a list of dicts, got {'force'"),
        (3, {}, TypeError, "cases must be a list"),
        ([{}, 3], {}, TypeError, r"cases\[1\] must be a dict .* got 3"),
        ([{}, {"forces": {}}], {}, TypeError, r"cases\[1\] must have no other keys .* 'forces'"),
        ([{"force": {"z": None}}], {}, ValueError, r"cases\[0\]: force: no subdomain 'z'"),
        ([{}, {"force": {"a": [1.0]}}], {}, ValueError, r"cases\[1\]: force must"),
        ([{"u0": {"a": [np.nan] * 6}}], {}, ValueError, r"cases\[0\]: u0 of 'a'"),
        ([{"v0": {"a": np.ones(6)}}], {}, pm.ConstraintError, r"cases\[0\]: "),
        ([{}], {"steps": None}, TypeError, "t_end or steps"),
        ([{}], {"steps": -1}, ValueError, "steps"),
        ([{}], {"every": 0}, ValueError, "every"),
        ([], {}, ValueError, r"cases must have at least one case, got none in \[\]"),
        ([{}], {"record": {"z": None}}, ValueError, "record"),
        ([{}], {"record_to": "x.h5"}, TypeError, "record_to must be a list of paths"),
        ([{}, {}], {"record_to": ["x.h5"]}, ValueError, "one path for each of 2 cases, got 1"),
        ([{}, {}], {"record_to": ["x", "x"]}, ValueError, "got one twice"),
        ([{}], {"overwrite": True}, ValueError, "record_to"),
        ([{}], {"progress": 3}, TypeError, "progress"),
    ],
)
def test_wrong_input_is_refused_before_anything_begins(cases, options, error, message):
    calls = []

    def force(t):
        calls.append(t)
        return np.zeros(6)

    ours = coupler(force=force)
    with pytest.raises(error, match=message):
        ours.run_each(cases, **({"steps": 2} | options))
    assert calls == [] and ours.step_count == 0


@pytest.mark.gate
def test_a_file_for_each_case(tmp_path):
    pytest.importorskip("h5py")
    ours, theirs = coupler(), coupler()
    cases = random_cases(ours, 3)
    paths = [tmp_path / f"{k}.h5" for k in range(3)]
    found = ours.run_each(cases, steps=5, record_to=paths)
    for x, path, y in zip(found, paths, one_by_one(theirs, cases, steps=5), strict=True):
        assert_identical(x, y)
        assert_identical(pm.History.load(path), y)
    with pytest.raises(FileExistsError):
        ours.run_each(cases, steps=5, record_to=[tmp_path / "new.h5", *paths[1:]])
    assert not (tmp_path / "new.h5").exists()
    ours.run_each(cases[:1], steps=2, record_to=paths[:1], overwrite=True)
    assert pm.History.load(paths[0]).macro_times.size == 3


@pytest.mark.parametrize("count", [3, 30])
def test_progress_counts_the_steps_of_all_cases(count):
    seen = []
    coupler().run_each(
        [{}] * count, steps=5, progress=lambda done, total: seen.append((done, total))
    )
    assert seen[-1] == (5 * count, 5 * count) and sorted(seen) == seen
    with pytest.raises(ZeroDivisionError):
        coupler().run_each([{}] * count, steps=5, progress=lambda done, total: 1 / 0)
