"""Warnings of workers point at the line of the user."""

import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest

import pmalpha as pm
from pmalpha import errors


def growing():
    """A force with the wrong sign, of which a run warns."""
    s = pm.Subdomain([1.0], None, scheme=pm.Newmark(), u0=[1.0], restoring=wrong, name="mass")
    return pm.Coupler([s], dt=0.1)


def wrong(t, u, v):
    return -u


@pytest.mark.parametrize("together", [1, 2])
def test_a_warning_of_a_thread_points_at_the_line_that_began_the_study(together):
    study = pm.Study(growing, steps=60, together=together)
    for workers in (0, 2):
        with pytest.warns(pm.StabilityWarning) as found:
            if workers:
                with ThreadPoolExecutor(workers) as pool:
                    study.run([{}, {}, {}], map=pool.map)
            else:
                study.run([{}, {}, {}])
        assert {w.filename for w in found} == {__file__}


def test_a_warning_of_an_executor_that_maps_the_study_points_at_the_line_that_made_it():
    with pytest.warns(pm.StabilityWarning) as found, ThreadPoolExecutor(2) as pool:
        assert all(case.error is None for case in pool.map(pm.Study(growing, steps=60), [{}, {}]))
    assert {w.filename for w in found} == {__file__}


def test_the_users_own_function_in_a_worker_is_the_line_of_its_warnings():
    line = ("elsewhere.py", 7, "elsewhere")
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        errors.for_line(line, errors.warn, "of the package", UserWarning)
        errors.for_line(line, lambda: errors.warn("of a function of the user", UserWarning))
        errors.warn("after it", UserWarning)
    assert [(w.filename, w.lineno) for w in found][0] == line[:2]
    assert [w.filename for w in found][1:] == [__file__] * 2
    assert errors.users_line()[0] == __file__
    assert errors.for_line(line, errors.users_line) == line
