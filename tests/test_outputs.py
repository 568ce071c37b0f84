"""run(outputs=): linear combinations of the motion, recorded instead of the dofs."""

import tracemalloc

import numpy as np
import pytest
import scipy.sparse as sp
from pairwise import pairwise
from reference_problems import random_problem

import pmalpha as pm
from pmalpha.results.quantities import (
    Combination,
    CoreRecord,
    CoreSelection,
    OutputRows,
    SpringRows,
)

EPS = np.finfo(float).eps


def made(seed, coupling, **options):
    """A random problem under another coupling."""
    problem = random_problem(seed)
    problem.coupling = coupling
    for s in problem.subdomains:
        s.double = s.double and coupling == "pm"
    return problem.coupler(**options)


def weights(coupler, seed=0):
    """Outputs of every subdomain: of u, and a mix of u, v and a with an empty row."""
    rng = np.random.default_rng(seed)
    chosen = {}
    for i, (_, s) in enumerate(coupler._session.keys):
        mix = {q: rng.normal(size=(3, s.n)) for q in "uva"}
        for W in mix.values():
            W[1] = 0.0
        chosen[i] = {"of u": rng.normal(size=s.n), "mix": mix | {"v": sp.coo_array(mix["v"])}}
    return chosen


def dense(W):
    return W.toarray() if sp.issparse(W) else np.atleast_2d(W)


def expected(own, given):
    """The output and the sum of the moduli of its terms, from all dofs."""
    given = given if isinstance(given, dict) else {"u": given}
    terms = [(getattr(own, q), dense(W)) for q, W in given.items()]
    return sum(x @ W.T for x, W in terms), sum(np.abs(x) @ np.abs(W).T for x, W in terms)


@pytest.mark.parametrize(
    ("coupling", "seed", "every"), pairwise(["pm", "gc", "macro"], range(4), [None, 3])
)
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_outputs_are_the_products_with_all_dofs(coupling, seed, every):
    coupler = made(seed, coupling)
    chosen = weights(coupler)
    coupler.step(2)
    history = coupler.run(steps=7, every=every, outputs=chosen)
    for i, own in enumerate(history.subdomains):
        assert list(own.outputs) == ["of u", "mix"]
        for name, given in chosen[i].items():
            values, size = expected(own, given)
            assert own.outputs[name].shape == values.shape
            # under "macro" two parts of a state, free and link, are combined one by one, and the
            # free one can be larger than their sum
            tolerance = 100 * EPS * (size + size.max())
            assert np.all(np.abs(own.outputs[name] - values) <= tolerance)
        assert np.all(own.outputs["mix"][:, 1] == 0.0)
    assert any(np.all(own.outputs["mix"][:, 0] != 0.0) for own in history.subdomains)


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_outputs_are_bitwise_identical_in_memory_in_a_file_and_with_threads(tmp_path, coupling):
    pytest.importorskip("h5py")
    first, second, third = (made(3, coupling, threads=k) for k in (1, 2, 1))
    chosen = weights(first)
    all_dofs = first.run(steps=9, outputs=chosen)
    for other in (
        second.run(steps=9, record={}, outputs=chosen),
        third.run(steps=9, record={}, outputs=chosen, record_to=tmp_path / "run.h5"),
    ):
        for a, b in zip(all_dofs.subdomains, other.subdomains):
            assert b.u.shape == (a.t.size, 0)
            require_same(a.outputs, b.outputs)


def require_same(ours, theirs):
    assert list(ours) == list(theirs)
    for name, x in ours.items():
        assert np.array_equal(x, theirs[name])


def sdof(name, k, c, **options):
    scheme = pm.GeneralizedAlpha(0.8)
    return pm.Subdomain([1.0], [k], C=[c], scheme=scheme, name=name, **options)


def test_the_base_shear_balances_the_inertia_forces():
    """Of a chain on a spring and a dashpot, cut at its third mass: k u_0 + c v_0 = -sum m w."""
    k, c = 30.0, 0.5
    spring = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K = np.zeros((3, 3))
    K[:2, :2] += 20.0 * spring
    K[1:, 1:] += 10.0 * spring
    K[0, 0] += k
    C = np.diag([c, 0.0, 0.0])
    m_a, m_b = np.array([2.0, 1.0, 0.5]), np.array([0.7, 1.5])
    scheme = pm.GeneralizedAlpha(0.8)
    a = pm.Subdomain(m_a, K, C=C, scheme=scheme, v0=[0.0, 0.0, 1.0], name="a")
    b = pm.Subdomain(m_b, 15.0 * spring, scheme=scheme, substeps=4, v0=[1.0, 2.0], name="b")
    first = [[1.0, 0.0, 0.0]]
    shear = {"u": k * np.array(first), "v": c * np.array(first)}
    outputs = {"a": {"base shear": shear, "inertia": {"a": -m_a}}, "b": {"inertia": {"a": -m_b}}}
    history = pm.Coupler([a, b], pm.tie(a, 2, b, 0), dt=0.02, coupling="pm").run(
        steps=40, record={}, outputs=outputs
    )
    inertia = history["a"].outputs["inertia"] + history["b"].outputs["inertia"][::4]
    # the scheme has equilibrium at the end of each step, to rounding of stiffness times motion
    np.testing.assert_allclose(
        history["a"].outputs["base shear"], inertia, rtol=0.0, atol=1e-12 * np.abs(inertia).max()
    )
    assert np.abs(inertia).max() > 1.0


def test_a_long_run_with_one_output_keeps_no_dofs_in_memory():
    n, steps = 20_000, 200
    one = np.ones(n)
    bar = pm.Subdomain(one, one, scheme=pm.CentralDifference(), v0=one, name="bar")
    coupler = pm.Coupler([bar], dt=0.1)
    coupler.step()
    mean = np.full(n, 1.0 / n)
    tracemalloc.start()
    try:
        history = coupler.run(steps=steps, record={}, outputs={"bar": {"mean": mean}})
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert history["bar"].outputs["mean"].shape == (steps + 1, 1)
    # W and its copies are some vectors of n numbers; all dofs would be 3 * 201 of them
    assert peak < 20 * 8 * n


# ---- files and other libraries ------------------------------------------------------------------


NAMES = ("Grundschub ↔", "N/V.M\0")  # none that a path or an array of a file could have


def two(outputs=True):
    a, b = sdof("a", 4.0, 0.1, u0=[1.0]), sdof("b", 9.0, 0.2, u0=[1.0], substeps=3)
    coupler = pm.Coupler([a, b], pm.tie(a, 0, b, 0), dt=0.05, coupling="pm")
    given = {"a": {NAMES[0]: [4.0]}, "b": dict.fromkeys(NAMES, [[9.0], [1.0]])}
    return coupler, dict(record={"a": [0]}, outputs=given if outputs else None)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_a_file_contains_the_outputs(tmp_path, suffix):
    pytest.importorskip("h5py")
    coupler, options = two()
    history = coupler.run(steps=4, **options)
    path = tmp_path / f"run{suffix}"
    history.save(path)
    loaded = pm.History.load(path)
    for ours, theirs in zip(loaded.subdomains, history.subdomains):
        require_same(ours.outputs, theirs.outputs)
    assert repr(loaded) == repr(history)
    assert repr(loaded["b"]) == "<'b': 13 time levels, 0 dofs, 2 outputs>"


def test_an_hdf5_file_names_the_outputs(tmp_path):
    h5py = pytest.importorskip("h5py")
    coupler, options = two()
    coupler.run(steps=4, **options, record_to=tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        outputs = file["b/outputs"]
        assert [outputs[k].attrs["name"] for k in "01"] == [NAMES[0], "N/V.M?"]
        assert outputs["0"].shape == (13, 2)
        assert "a row for each time level" in outputs["0"].attrs["description"]


@pytest.mark.gate
def test_a_continued_file_has_the_outputs_of_both_runs(tmp_path):
    pytest.importorskip("h5py")
    coupler, options = two()
    whole = coupler.run(steps=9, **options)
    coupler, options = two()
    path = tmp_path / "run.h5"
    coupler.run(steps=4, **options, record_to=path)
    coupler.save(tmp_path / "state.npz")
    for name, factor in (("a", 2.0), ("other", 1.0)):
        changed = {"a": {NAMES[0] if name == "a" else name: [factor * 4.0]}}
        with pytest.raises(ValueError, match="append: .*run.h5' must"):
            other = options | {"outputs": options["outputs"] | changed}
            coupler.run(steps=1, **other, record_to=path, append=True)
    with pytest.raises(ValueError, match="append: .*the same coupler, dt and recorded quantities"):
        coupler.run(steps=1, record={"a": [0], "b": []}, record_to=path, append=True)
    history = coupler.run(steps=5, **options, record_to=path, append=True)
    for ours, theirs in zip(history.subdomains, whole.subdomains):
        require_same(ours.outputs, theirs.outputs)


def test_joined_histories_have_the_outputs_of_all():
    coupler, options = two()
    whole = coupler.run(steps=9, **options)
    coupler, options = two()
    pieces = [coupler.run(steps=k, **options) for k in (4, 5)]
    joined = pm.History.join(pieces)
    for ours, theirs in zip(joined.subdomains, whole.subdomains):
        require_same(ours.outputs, theirs.outputs)
    options["outputs"] = {"a": {NAMES[0]: [[4.0], [1.0]]}, "b": options["outputs"]["b"]}
    with pytest.raises(ValueError, match="springs and outputs, and constraints, piece 1 differs"):
        pm.History.join([pieces[0], coupler.run(steps=1, **options)])


def test_the_history_after_an_exception_has_the_outputs_so_far():
    def force(t):
        if t > 0.32:
            raise RuntimeError("broken")
        return [np.sin(t)]

    coupler = pm.Coupler([sdof("a", 4.0, 0.0, force=force)], dt=0.1)
    with pytest.raises(RuntimeError, match="broken"):
        coupler.run(steps=9, outputs={"a": {"pull": [4.0]}})
    own = coupler.last_history["a"]
    assert own.outputs["pull"].shape == (4, 1)
    assert np.array_equal(own.outputs["pull"], 4.0 * own.u)


def test_pandas_and_xarray_have_the_outputs():
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    coupler, options = two()
    history = coupler.run(steps=4, **options)
    name, own = NAMES[0], history["b"]
    assert np.array_equal(own.to_pandas()[name], own.outputs[name])
    assert list(history.to_pandas()["b"].columns) == [(x, i) for x in NAMES for i in (0, 1)]
    alone, whole = own.to_xarray(), history.to_xarray()
    assert np.array_equal(alone[name], own.outputs[name]) and alone[name].dims[0] == "time"
    assert np.array_equal(whole[f"b_{name}"], own.outputs[name])
    assert whole[f"b_{name}"].dims[0] == "b_time"


@pytest.mark.parametrize("of_u", [sp.dok_matrix, sp.dok_array, sp.lil_matrix])
def test_weights_in_a_sparse_matrix_that_is_a_dict_too_are_those_of_the_matrix(of_u):
    s = pm.Subdomain([1.0, 2.0], [3.0, 4.0], v0=[1.0, -1.0], scheme=pm.Newmark(), name="s")
    W = of_u([[2.0, 5.0]])
    outputs = {"s": {"x": W, "y": {"v": W}}}
    history = pm.Coupler([s], dt=0.1).run(steps=3, outputs=outputs)["s"]
    # sums of two products, in any order
    np.testing.assert_allclose(history.outputs["x"], history.u @ [[2.0], [5.0]], rtol=1e-14)
    np.testing.assert_allclose(history.outputs["y"], history.v @ [[2.0], [5.0]], rtol=1e-14)


def test_an_uncoupled_subdomain_has_outputs_too():
    motion = pm.solve(sdof("a", 4.0, 0.0, u0=[1.0]), dt=0.1, steps=5, outputs={0: {"f": 4.0}})
    assert np.array_equal(motion.outputs["f"], 4.0 * motion.u)


# ---- bad input ----------------------------------------------------------------------------------


BAD = [
    (5, TypeError, "outputs must be a dict by subdomain, got 5"),
    ({"c": {"x": [1.0]}}, ValueError, "outputs: no subdomain 'c'"),
    ({"a": [1.0]}, TypeError, r"outputs\['a'\] must be a dict of matrices by name, got \[1.0\]"),
    ({"a": {}}, TypeError, "must be a dict of matrices by name, got {}"),
    ({"a": {1: [1.0]}}, ValueError, "must have names other than .*'u', .*, got 1"),
    ({"a": {"": [1.0]}}, ValueError, "must have names other than"),
    ({"a": {"u": [1.0]}}, ValueError, "must have names other than .*, got 'u'"),
    ({"a": {"x": [1.0, 2.0]}}, ValueError, r"outputs\['a'\]\['x'\] must have 1 column, got"),
    ({"a": {"x": [[1.0, 2.0]]}}, ValueError, r"must have 1 column, got shape \(1, 2\)"),
    ({"a": {"x": [[[1.0]]]}}, ValueError, "must be a .*2-D array, got shape"),
    ({"a": {"x": [np.nan]}}, ValueError, r"outputs\['a'\]\['x'\] must be finite, got nan"),
    ({"a": {"x": [1j]}}, TypeError, "must hold real numbers"),
    ({"a": {"x": sp.csr_array([[np.inf]])}}, ValueError, "stored entries .* must be finite"),
    ({"a": {"x": np.zeros((0, 1))}}, ValueError, r"one number of rows, at least 1, got \[0\]"),
    ({"a": {"x": {}}}, ValueError, "a dict of these by 'u', 'v' or 'a', got keys"),
    ({"a": {"x": {"w": [1.0]}}}, ValueError, r"by 'u', 'v' or 'a', got keys \['w'\]"),
    ({"a": {"x": {"v": [1.0, 2.0]}}}, ValueError, r"outputs\['a'\]\['x'\]\['v'\] must have 1 col"),
    ({"a": {"x": {"u": [1.0], "v": [[1.0], [2.0]]}}}, ValueError, r"number of rows.*\[1, 2\]"),
]


@pytest.mark.parametrize(("outputs", "error", "words"), BAD, ids=[x[2] for x in BAD])
def test_wrong_outputs_are_refused_before_the_first_step(outputs, error, words):
    coupler, _ = two(outputs=False)
    with pytest.raises(error, match=words):
        coupler.run(steps=1, outputs=outputs)
    assert coupler.step_count == 0


def i64(*values):
    return np.array(values, np.int64)


GOOD = (i64(0, 1), i64(0), np.ones(1))
BAD_COMBINATIONS = {
    "number": 5,
    "two arrays": GOOD[:2],
    "start of int32": (GOOD[0].astype(np.int32), *GOOD[1:]),
    "too few starts": (i64(0), *GOOD[1:]),
    "does not begin at zero": (i64(1, 1), *GOOD[1:]),
    "ends beyond": (i64(0, 2), *GOOD[1:]),
    "ends before": (i64(0, 0), *GOOD[1:]),
    "position too far": (GOOD[0], i64(1), GOOD[2]),
    "position negative": (GOOD[0], i64(-1), GOOD[2]),
    "two weights": (*GOOD[:2], np.ones(2)),
    "weights of int": (*GOOD[:2], i64(1)),
}


def combination(parts):
    """A form of so many parts, or what is none."""
    return dict(zip(Combination._fields, parts)) if isinstance(parts, tuple) else parts


def core_of_one():
    return pm.Coupler([sdof("a", 4.0, 0.0, u0=[1.0])], dt=0.1)._session.core


def record_of(outputs, springs=None):
    none = np.zeros((3, 0))
    selection = CoreSelection(i64(), none, none, none, springs, outputs, None)
    return CoreRecord(0, 0, (selection,), none, none, none)


@pytest.mark.parametrize("kind", BAD_COMBINATIONS)
def test_the_core_is_not_entered_with_weights_that_do_not_fit(kind):
    core, y = core_of_one(), np.zeros((3, 1))
    for place in range(3):
        combinations = [Combination(*GOOD), None, None]
        combinations[place] = combination(BAD_COMBINATIONS[kind])
        with pytest.raises((TypeError, ValueError)):
            core.advance(2, record_of(OutputRows(y, *combinations)))
    core.advance(2, record_of(OutputRows(y, Combination(*GOOD), None, None)))
    assert np.all(y[1:] != 0.0)


BAD_OUTPUTS = {
    "number": 5,
    "plain tuple": (np.zeros((3, 1)), Combination(*GOOD), None, None),
    "too few rows": OutputRows(np.zeros((2, 1)), Combination(*GOOD), None, None),
    "one axis": OutputRows(np.zeros(3), Combination(*GOOD), None, None),
    "float32": OutputRows(np.zeros((3, 1), np.float32), Combination(*GOOD), None, None),
    "two columns": OutputRows(np.zeros((3, 2)), Combination(*GOOD), None, None),
}


BAD_RECORDS = {name: record_of(outputs) for name, outputs in BAD_OUTPUTS.items()} | {
    f"springs {i}": record_of(None, springs)
    for i, springs in enumerate(
        [5, {"number": i64()}, SpringRows(i64(0), np.zeros((3, 1)), np.zeros((3, 1)))]
    )
}


@pytest.mark.parametrize("kind", BAD_RECORDS)
def test_the_core_is_not_entered_with_outputs_and_springs_that_do_not_fit(kind):
    with pytest.raises((TypeError, ValueError)):
        core_of_one().advance(2, BAD_RECORDS[kind])


def test_outputs_that_decrease_are_refused_by_the_core():
    falls = i64(0, 2, 1), i64(0), np.ones(1)
    with pytest.raises(ValueError, match="start must rise"):
        core_of_one().advance(
            2, record_of(OutputRows(np.zeros((3, 2)), Combination(*falls), None, None))
        )
