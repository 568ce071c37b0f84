"""The private types of the C extension: their names, what they own, the order of calls."""
# ruff: noqa: B023 - lambdas made in a loop are called in the same round

import ast
import contextlib
import copy
import gc
import importlib
import os
import pickle
import shutil
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
from core_objects import (
    BLAS,
    NONE,
    ONE,
    SPD,
    check_refused,
    coupler,
    coupler_arguments,
    f64,
    factor,
    i32,
    i64,
    in_a_process,
    operator,
    panels_of,
    record,
    started,
    step,
    subdomain,
    subdomain_arguments,
)

from pmalpha import _core
from pmalpha.problem import forms

# ---- names --------------------------------------------------------------------------------------


def test_the_stub_names_what_the_module_has():
    tree = ast.parse(Path(_core.__file__).with_name("_core.pyi").read_text())
    stub = {node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
    stub |= {node.target.id for node in tree.body if isinstance(node, ast.AnnAssign)}
    assert stub == {name for name in dir(_core) if not name.startswith("__")}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            members = {m.name for m in node.body if isinstance(m, ast.FunctionDef)}
            members |= {m.target.id for m in node.body if isinstance(m, ast.AnnAssign)}
            members = {name for name in members if not name.startswith("__")}
            there = {name for name in vars(getattr(_core, node.name)) if not name.startswith("__")}
            assert members == there


def test_the_library_exports_its_init_function_and_nothing_else():
    nm = shutil.which("nm")
    if nm is None or sys.platform != "linux":
        pytest.skip("needs nm of a Linux toolchain")
    lines = subprocess.run([nm, "-D", "--defined-only", _core.__file__], capture_output=True)
    names = {line.split()[-1] for line in lines.stdout.decode().splitlines()}
    assert names - {"_init", "_fini"} == {"PyInit__core"}


@pytest.mark.parametrize("name", ["Subdomain", "Coupler"])
def test_the_types_belong_to_the_module_and_cannot_be_changed(name):
    cls = getattr(_core, name)
    assert cls.__module__ == "pmalpha._core" and cls.__doc__
    with pytest.raises(TypeError, match="immutable"):
        cls.extra = 1
    with pytest.raises(TypeError, match="not an acceptable base type"):
        type("Sub", (cls,), {})
    with pytest.raises(AttributeError):
        (subdomain() if name == "Subdomain" else coupler()).extra = 1


@pytest.mark.parametrize("cls", [_core.Subdomain, _core.Coupler])
def test_objects_cannot_be_made_without_their_arguments(cls):
    for make in (cls, lambda: cls.__new__(cls), lambda: object.__new__(cls), lambda: cls(None)):
        with pytest.raises(TypeError):
            make()
    with pytest.raises(TypeError):
        cls(**(subdomain_arguments() | coupler_arguments()))


def test_objects_cannot_be_copied_or_pickled():
    for made in (subdomain(), coupler()):
        for copied in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match="pickle"):
                copied(made)


def test_methods_refuse_objects_of_another_type():
    s, c = subdomain(), coupler()
    for call in (
        lambda: _core.Subdomain.state(c),
        lambda: _core.Subdomain.start(5, 1, 2, 3, 4),
        lambda: _core.Coupler.advance(s, 1, None),
        lambda: _core.Coupler.step_count.__get__(s),
    ):
        with pytest.raises(TypeError):
            call()
    for name in ("step_count", "multipliers", "prescribed"):
        with pytest.raises(AttributeError):
            setattr(c, name, 1)
        with pytest.raises(AttributeError):
            delattr(c, name)


def test_calling_init_again_does_nothing():
    c, s = started()
    before = s.state()
    s.__init__()
    c.__init__()
    for x, y in zip(before, s.state(), strict=True):
        np.testing.assert_array_equal(x, y)


def test_the_module_can_be_loaded_again():
    again = importlib.reload(_core)
    assert again.Subdomain is not None
    c, _ = started()
    assert c.advance(3, None) is None


# ---- ownership ----------------------------------------------------------------------------------


class Watched(np.ndarray):
    """An array that can be watched."""


def watched(array):
    """The array, and a list that gets an entry when the array is freed."""
    array, gone = array.view(Watched), []
    weakref.finalize(array, gone.append, True)
    return array, gone


def test_arrays_live_as_long_as_the_core_points_into_them():
    K, gone = watched(f64(4.0, 9.0))
    load, load_gone = watched(f64(1.0, 2.0))
    c, s = started(K=K)
    expected, t = started()
    for x in (s, t):
        x.set_load(load if x is s else f64(1.0, 2.0))
    del K, load, x
    gc.collect()
    junk = [np.full(2, np.nan) for _ in range(1000)]  # would be allocated at the same address
    assert not gone and not load_gone
    c.advance(50, None)
    expected.advance(50, None)
    np.testing.assert_array_equal(s.state()[0], t.state()[0])
    s.set_load(None)
    assert load_gone and not gone
    del s
    gc.collect()
    assert not gone  # the coupler holds the subdomain
    del c
    gc.collect()
    assert gone
    del junk


def test_arrays_of_a_refused_object_are_released():
    K, gone = watched(f64(4.0, 9.0))
    with pytest.raises(ValueError):
        subdomain(K=K, link=(1, i64(0, 1), i32(7), f64(1.0)))
    del K
    gc.collect()
    assert gone


def test_a_cycle_through_an_array_is_collected():
    K, gone = watched(f64(4.0, 9.0))
    s = subdomain(K=K)
    K.owner = s
    del K, s
    gc.collect()
    assert gone


def test_reference_counts_are_what_they_were():
    K, u, two = f64(4.0, 9.0), np.ones(2), operator()
    twice = (step(0.2), two[1], None)
    link = (1, i64(0, 1), i32(0), f64(1.0))
    objects = [K, u, two, two[1], link, *link[1:], ONE, ONE[0], None, _core.Subdomain]
    objects += [_core.Coupler, record, BLAS[0]]

    def use():
        s = subdomain(K=K, single=two, twice=twice, link=link)
        c = coupler(subdomains=(s,), motions=(link[1][:1],))
        s.set_load(u)
        s.set_load(forms.Table(np.ones((3, 2)), 0))
        s.start(u, u, u, ONE[0])
        c.start(0, ONE[0], ONE[0])
        c.set_motion(0, ONE[0])
        c.advance(2, record(rows=3))
        s.set_levels(s.levels())
        s.compliance(True, i64(0))
        factor(*panels_of(SPD))
        for call in (
            lambda: subdomain(K=K, single=two, link=None),
            lambda: subdomain(K=K, single=two, link=(1, i64(0, 1), i32(7), f64(1.0))),
            lambda: coupler(H=(u, None)),
            lambda: coupler(motions=(i64(5),)),
            lambda: c.advance(1, 5),
            lambda: c.advance(1, record(rows=1)),
            lambda: s.set_load(forms.Sampled(u, None, 0.1, True, 0.0)),
            lambda: s.set_levels({"u": u}),
            lambda: s.start(u, u, u, u),
            lambda: factor(None, None, u, u),
        ):
            with contextlib.suppress(TypeError, ValueError, SystemError):
                call()

    use()
    gc.collect()
    # the count of an immortal object, None from Python 3.12 on, has no meaning
    objects = [x for x in objects if sys.getrefcount(x) < 2**30]
    assert len(objects) > 8

    def change():
        before = [sys.getrefcount(x) for x in objects]
        for _ in range(120):
            use()
        gc.collect()
        after = [sys.getrefcount(x) for x in objects]
        return max(abs(x - y) for x, y in zip(before, after, strict=True))

    # One reference lost or kept in each of 120 rounds would be 120, every time. None and the types
    # are used by whatever else runs, and released by it at some time.
    assert any(change() < 60 for _ in range(5))


def resident():
    """Bytes of memory of this process."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.gate
@pytest.mark.skipif(sys.platform != "linux", reason="/proc is read")
def test_memory_of_the_core_is_freed():
    n = 20_000
    parts = {"n": n, "nb": 0, "K": np.ones(n), "single": operator(n, 0.05), "twice": operator(n)}
    parts |= {"link": (0, i64(0), i32(), f64()), "substeps": 2}

    def make():
        s = subdomain(**parts)
        c = coupler(subdomains=(s,), p=0, H=NONE, H_start=NONE)
        zero, none = np.zeros(n), np.empty(0)
        s.start(zero, zero, zero, none)
        c.start(0, none, none)
        s.levels()
        with contextlib.suppress(ValueError):
            subdomain(**parts | {"nb": 1, "link": (1, i64(0, 1), i32(9), f64(1.0))})

    for _ in range(10):
        make()
    before = resident()
    for _ in range(300):
        make()
    # four states of four vectors are 2.6 MB: 300 of them would be 770 MB; malloc keeps a few
    assert resident() - before < 50e6


# ---- order of calls -----------------------------------------------------------------------------


def test_nothing_runs_before_a_start():
    c = coupler()
    for call in (lambda: c.advance(1, None), lambda: c.advance(0, None)):
        with pytest.raises(RuntimeError, match="no initial state"):
            call()
    assert c.step_count == 0


def test_counts_of_steps_are_whole_and_not_negative():
    c, _ = started()
    for steps in (-1, 1.0, None, "1", 2**63, 2**70):
        check_refused(lambda steps=steps: c.advance(steps, None))
    for begin in (-1, 1.0, None, 2**63):
        check_refused(lambda begin=begin: c.start(begin, np.zeros(1), np.zeros(1)))
    for args in ((), (1,), (1, None, 3), (1, None, None, None)):
        check_refused(lambda args=args: c.advance(*args))


def test_a_count_of_steps_that_overflows_is_refused():
    c, _ = started()
    check_refused(lambda: c.start(2**63 - 1, np.zeros(1), np.zeros(1)))
    assert c.step_count == 0
    c.start(2**53, np.zeros(1), np.zeros(1))
    check_refused(lambda: c.advance(1, None))
    assert c.step_count == 2**53


def test_a_count_of_substeps_that_overflows_is_refused():
    # 2^53 substeps can be counted: 2^41 macro steps of 2^12
    c, _ = started(substeps=2**12)
    check_refused(lambda: c.start(2**41 + 1, np.zeros(1), np.zeros(1)))
    assert c.step_count == 0
    c.start(2**41 - 1, np.zeros(1), np.zeros(1))
    check_refused(lambda: c.advance(2, None))
    assert c.advance(1, None) is None
    assert c.step_count == 2**41


def test_compliance_is_computed_for_existing_constraints_only():
    s = subdomain()
    for rows in (i64(1), i64(-1), i64(0, 5), i32(0), [0], None, f64(0), i64(0).reshape(1, 1)):
        check_refused(lambda rows=rows: s.compliance(False, rows))
    check_refused(lambda: s.compliance(True, i64(0)))  # it takes no double steps
    assert s.compliance(False, i64()).shape == (0, 0)
    # al2 = h / 2, all the rest is one
    np.testing.assert_array_equal(s.compliance(False, i64(0, 0)), np.full((2, 2), 0.05))
    huge = subdomain(link=(2**58, i64(0, 1), i32(0), f64(1.0)))
    with pytest.raises(MemoryError):
        huge.compliance(False, i64(0))


def test_saved_states_are_restored_as_they_were():
    for twice, count in ((None, 7), (operator(h=0.2), 14)):
        c, s = started(twice=twice)
        c.advance(3, None)
        nodes = s.levels()
        assert len(nodes) == count
        c.advance(2, None)
        after = s.levels()
        s.set_levels(nodes)
        c.start(3, c.multipliers, np.zeros(1))
        c.advance(2, None)
        assert s.levels().keys() == after.keys()
        for name in ("u", "v", "w", "a", "vf", "springs"):
            np.testing.assert_array_equal(s.levels()[name], after[name])
        others = {"u": nodes["u"]}, nodes | {"x": nodes["u"]}, nodes | {"u": np.ones(3)}
        for bad in (*others, tuple(nodes.values()), list(nodes), None, {}):
            check_refused(lambda bad=bad: s.set_levels(bad))


def test_lengths_of_steps_that_do_not_agree_are_refused():
    # the double step is twice as long, to the last bit; h substeps = dt to two roundings
    h = 0.1 / 3
    coupler(subdomains=(subdomain(substeps=3, single=operator(h=h), twice=operator(h=2 * h)),))
    with pytest.raises(ValueError, match="lengths of steps do not agree"):
        subdomain(substeps=3, single=operator(h=h), twice=operator(h=2 * h * (1 + 1e-12)))
    for wrong in (0.1, h * (1 + 1e-12), np.nan):
        with pytest.raises(ValueError, match="lengths of steps do not agree"):
            coupler(subdomains=(subdomain(substeps=3, single=operator(h=wrong)),))


def test_arrays_that_cannot_be_written_are_refused_for_unit_responses():
    s = subdomain(substeps=2, has_responses=True)
    arrays = {"end": np.zeros((1, 1)), "mean": np.zeros((1, 1)), "states": np.zeros((1, 4, 2))}
    assert s.unit_responses(i64(0), *arrays.values())
    kept = {name: array.copy() for name, array in arrays.items()}
    for name, array in arrays.items():
        array.flags.writeable = False
        with pytest.raises(ValueError, match=f"{name} must be writeable"):
            s.unit_responses(i64(0), *arrays.values())
        array.flags.writeable = True
        np.testing.assert_array_equal(array, kept[name])
    for threads in (0, -1, 1025):
        with pytest.raises(ValueError, match="threads must lie in 1..1024"):
            s.unit_responses(i64(0), *arrays.values(), False, threads)


def test_the_number_of_steps_is_not_read_while_they_are_made():
    seen = []

    def report(count):
        seen.append(count)
        with pytest.raises(RuntimeError, match="being stepped"):
            _ = c.step_count

    c, _ = started()
    c.advance(1_000_000, None, report)
    assert seen and c.step_count == 1_000_000


def test_the_same_subdomain_twice_in_a_coupler_is_refused():
    out = in_a_process("""
s = subdomain(substeps=3, twice=operator(h=2 * (0.1 / 3)))
try:
    started(subdomains=(s, s))
except RuntimeError:
    print("refused")
_ = s.state()  # it is free again
""")
    assert "refused" in out


def test_a_coupler_of_no_subdomains_can_be_interrupted():
    # an empty loop of 2^62 steps must check for signals or not begin
    code = """
none = np.empty(0)
try:
    parts = {"p": 0, "H_start": NONE, "H": NONE, "motions": (), "schedule": "fine"}
    c = _core.Coupler((), parts | {"options": {"dt": 0.1}})
    c.start(0, none, none)
    with waits.ctrl_c_when(lambda: True, after=0.2):
        c.advance(2**62, None)
except (KeyboardInterrupt, TypeError, ValueError):
    print("stopped")
"""
    assert "stopped" in in_a_process(code)
