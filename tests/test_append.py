"""Files of earlier runs: refused, continued, replaced; Histories of consecutive runs joined."""

import numpy as np
import pytest
from agreement import assert_identical
from reference_problems import random_problem

import pmalpha as pm
from pmalpha import models

h5py = pytest.importorskip("h5py")
OPTIONS = [{}, {"record": {0: [0]}, "every": 2}, {"every": 3}, {"record": {}}]
# a random problem and options
CASES = [(i % 4, OPTIONS[(i + i // 4) % 4]) for i in range(8)]


def four_dof():
    return models.four_dof().coupler(0.05, coupling="pm")


# ---- an existing file -----------------------------------------------------------------------


def test_an_existing_file_is_refused_and_unchanged(tmp_path):
    path = tmp_path / "run.h5"
    coupler = four_dof()
    coupler.run(steps=5, record_to=path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match="append=True continues it, overwrite=True replaces"):
        coupler.run(steps=5, record_to=path)
    assert path.read_bytes() == before and coupler.step_count == 5


def test_a_rig_is_not_evaluated_before_an_existing_file_is_refused(tmp_path):
    evaluated = []

    def specimen(t, u, v):
        evaluated.append(t)
        return u

    (tmp_path / "run.h5").write_bytes(b"results of a year")
    rig = pm.Subdomain([1.0], None, scheme=pm.CentralDifference(), restoring=specimen)
    coupler = pm.Coupler([rig], dt=0.1)
    with pytest.raises(FileExistsError):
        coupler.run(steps=2, record_to=tmp_path / "run.h5")
    with pytest.raises(ValueError, match="format 'pmalpha History'"):
        coupler.run(steps=2, record_to=tmp_path / "run.h5", append=True)
    assert not evaluated and (tmp_path / "run.h5").read_bytes() == b"results of a year"


def test_overwrite_replaces_the_file(tmp_path):
    path = tmp_path / "run.h5"
    coupler, other = four_dof(), four_dof()
    coupler.run(steps=5, record_to=path)
    coupler.run(steps=4, record_to=path, overwrite=True)
    other.step(5)
    assert_identical(pm.History.load(path), other.run(steps=4))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"append": True}, ValueError, "must come with record_to"),
        ({"overwrite": True}, ValueError, "must come with record_to"),
        ({"append": True, "overwrite": True}, ValueError, "must not both be True"),
        ({"append": 1}, TypeError, "append must be True or False, got 1"),
        ({"overwrite": "yes"}, TypeError, "overwrite must be True or False"),
    ],
)
def test_wrong_options_are_named(options, error, message):
    with pytest.raises(error, match=message):
        four_dof().run(steps=1, **options)


# ---- append ---------------------------------------------------------------------------------


def test_energies_are_not_continued_since_works_count_from_the_beginning_of_a_run(tmp_path):
    path, coupler = tmp_path / "run.h5", four_dof()
    first = coupler.run(steps=3, record_to=path, append=True, energy=True)  # a new file
    before = path.read_bytes()
    with pytest.raises(ValueError, match="append must come without energies: works count from"):
        coupler.run(steps=3, record_to=path, append=True, energy=True)
    assert path.read_bytes() == before and coupler.step_count == 3
    with pytest.raises(ValueError, match="pieces must have no energies: works count from"):
        pm.History.join([first, coupler.run(steps=3)])
    assert pm.History.join([first]).energy is first.energy


def test_a_failed_run_leaves_the_rows_before_it(tmp_path):
    path = tmp_path / "run.h5"

    def force(t):
        if t > 1.0:
            raise ZeroDivisionError
        return [np.sin(t)]

    def coupler():
        s = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), force=force)
        return pm.Coupler([s], dt=0.1)

    ours = coupler()
    ours.run(steps=5, record_to=path)
    with pytest.raises(ZeroDivisionError):
        ours.run(steps=50, record_to=path, append=True)
    assert_identical(ours.last_history, coupler().run(steps=ours.step_count))
    assert ours.step_count == 10 == ours.last_history.macro_times.size - 1


@pytest.mark.gate
def test_a_file_of_something_else_is_not_continued(tmp_path):
    path = tmp_path / "run.h5"
    four_dof().run(steps=5, record_to=path)
    before = path.read_bytes()

    def refused(coupler, message, **options):
        with pytest.raises(ValueError, match=message):
            coupler.run(steps=2, record_to=path, append=True, **options)
        assert path.read_bytes() == before

    fresh, late, other, moved = (four_dof() for _ in range(4))
    refused(fresh, "must reach macro step 0, the present, .* from 0 to 5")
    late.step(6)
    refused(late, "must reach macro step 6")
    other.step(5)
    refused(other, "the same coupler, dt and recorded quantities", every=5)
    refused(other, "the same coupler, dt and recorded quantities", record={"A": [0]})
    shorter = models.four_dof().coupler(0.04, coupling="pm")
    shorter.step(5)
    refused(shorter, "the same coupler, dt and recorded quantities")
    u0 = {name: 2.0 * moved.state(name).u for name in ("A", "B")}
    moved.reset(u0=u0)
    moved.step(5)
    refused(moved, "must have the present state of the coupler")
    path.unlink()
    saved = four_dof()
    saved.run(steps=5).save(path)
    before = path.read_bytes()
    refused(saved, "must be a file of run\\(record_to=\\), not of History.save")


# ---- join -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed, options", CASES, ids=str)
def test_joined_histories_are_that_of_one_run(seed, options):
    ours, theirs = (random_problem(seed).coupler() for _ in range(2))
    pieces = [ours.run(steps=steps, **options) for steps in (6, 0, 12, 6)]
    assert_identical(pm.History.join(pieces), theirs.run(steps=24, **options))


def test_joined_springs_are_those_of_one_run():
    def coupler():
        joint = pm.Bilinear([0], k=4.0, fy=1.0)
        s = pm.Subdomain([1.0], None, scheme=pm.Newmark(), restoring=joint, v0=[3.0], name="s")
        return pm.Coupler([s], dt=0.1)

    ours, options = coupler(), {"record_springs": {"s": None}}
    whole = coupler().run(steps=30, **options)
    history = pm.History.join(ours.run(steps=n, **options) for n in (10, 20))
    for name in ("deformation", "force", "springs"):
        assert np.array_equal(getattr(history["s"], name), getattr(whole["s"], name))


def test_the_break_need_not_be_a_multiple_of_every():
    coupler = four_dof()
    first, second = coupler.run(steps=15, every=10), coupler.run(steps=15, every=10)
    joined = pm.History.join([first, second])
    assert np.allclose(joined.macro_times, [0.0, 0.5, 0.75, 1.0, 1.5], rtol=1e-14, atol=0.0)


def test_pieces_that_do_not_fit_are_refused():
    coupler = four_dof()
    first, second = coupler.run(steps=5), coupler.run(steps=5)
    coupler.step(1)
    third = coupler.run(steps=5)
    for pieces, message in (
        ([], "at least one History, got none"),
        ([first, third], "piece 1 begins at t = 0.55 where the one before ends at t = 0.25"),
        ([second, first], "must be consecutive"),
        ([first, first], "must be consecutive"),
        ([second, coupler.run(steps=0, record={"A": None})], "piece 1 differs"),
    ):
        with pytest.raises(ValueError, match=message):
            pm.History.join(pieces)
