"""Absolute outputs: the motion with that of the ground added, against supports that move."""

import numpy as np
import pytest

import pmalpha as pm

K = np.array([[50.0, -20.0], [-20.0, 20.0]])
NAMES = [f"absolute {x}" for x in "uva"]
ROOF = {"frame": {x: {x: {1: 1.0}} for x in NAMES}}


def shaken(force, **options):
    frame = pm.Subdomain(
        [2.0, 1.0], K, C=[0.3, 0.1], scheme=pm.Newmark(), force=force, name="frame", **options
    )
    rig = pm.Subdomain([1.0], [5.0], scheme=pm.Newmark(), force=force, name="rig")
    return pm.Coupler([frame, rig], pm.tie(frame, 0, rig, 0), dt=0.02, coupling="gc")


def moved(record, dt, steps):
    """The same frame with the ground as a dof, which a SupportMotion moves: absolute motion."""
    whole = np.zeros((3, 3))
    whole[1:, 1:] = K + np.diag([5.0, 0.0])
    whole[0, 1:] = whole[1:, 0] = -whole[1:, 1:].sum(axis=0)
    whole[0, 0] = whole[1:, 1:].sum()
    C = np.diag([0.4, 0.3, 0.1])
    C[0, 1:] = C[1:, 0] = [-0.3, -0.1]
    frame = pm.Subdomain([1.0, 3.0, 1.0], whole, C=C, scheme=pm.Newmark(), name="frame")
    ground = pm.SupportMotion(record, dt, "acceleration")
    held = pm.Constraint({frame: [[1.0, 0.0, 0.0]]}, velocity=ground)
    return pm.Coupler([frame], held, dt=0.02).run(steps=steps)["frame"]


@pytest.mark.parametrize("seed", range(5))
def test_absolute_motions_are_those_over_a_support_that_moves(seed):
    rng = np.random.default_rng(seed)
    # smooth beside the steps; it ends within the run, with a velocity that remains
    t = 0.05 * np.arange(40)
    record = np.sin(rng.uniform(1.0, 3.0) * t) * np.exp(-rng.uniform(0.0, 1.0) * t)
    run = shaken(pm.BaseAcceleration(record, dt=0.05)).run(steps=150, outputs=ROOF)
    absolute = moved(record, 0.05, 150)
    for name, kind in zip(NAMES, "uva"):
        x, y = run["frame"].outputs[name][:, 0], getattr(absolute, kind)[:, 2]
        # two discretizations of order 2, with about 60 steps in the shortest period: 2e-4; the
        # relative motion alone differs by its own size
        assert np.abs(x - y).max() < 1e-3 * np.abs(y).max()
        relative = getattr(run["frame"], kind)[:, 1]
        assert np.abs(relative - y).max() > 0.1 * np.abs(y).max()


@pytest.mark.parametrize("average", [False, True])
@pytest.mark.parametrize("every", [None, 3])
def test_absolute_accelerations_are_the_forces_on_the_masses(tmp_path, average, every):
    rng = np.random.default_rng(1)
    quakes = [
        pm.BaseAcceleration(rng.normal(size=(30, 2)), [[1.0, 0.2], [1.0, -0.3]], dt=0.03),
        pm.BaseAcceleration(rng.normal(size=20), dt=0.05, average=average),
    ]
    frame = pm.Subdomain([2.0, 1.0], K, C=[0.3, 0.1], scheme=pm.GeneralizedAlpha(0.6), force=quakes)
    wanted = {0: {"abs": {"absolute a": np.eye(2)}, "first": {"u": [1.0, 0.0]}}}
    coupler = pm.Coupler([frame], dt=0.02)
    run = coupler.run(steps=60, outputs=wanted, every=every)[0]
    # M (a + a_g) = -K u - C v at every time level, whatever the ground does: rounding
    forces = -run.u @ K - run.v * [0.3, 0.1]
    np.testing.assert_allclose(run.outputs["abs"] * [2.0, 1.0], forces, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(run.outputs["first"][:, 0], run.u[:, 0])
    coupler.reset()
    path = tmp_path / "run.h5"
    coupler.run(steps=25, outputs=wanted, every=every, record_to=path)
    filed = coupler.run(steps=35, outputs=wanted, every=every, record_to=path, append=True)[0]
    np.testing.assert_array_equal(filed.outputs["abs"], run.outputs["abs"])


def test_cases_have_the_ground_of_their_own_loads():
    rng = np.random.default_rng(2)
    records = [rng.normal(size=20) for _ in range(5)]
    cases = [{"force": {s: pm.BaseAcceleration(x, dt=0.05) for s in "frame rig".split()}}
             for x in records]  # fmt: skip
    coupler = shaken(None)
    for case, history in zip(cases, coupler.run_each(cases, steps=50, outputs=ROOF)):
        coupler.reset(**case)
        alone = coupler.run(steps=50, outputs=ROOF)["frame"].outputs
        for name in NAMES:
            np.testing.assert_array_equal(history["frame"].outputs[name], alone[name])


@pytest.mark.gate
@pytest.mark.parametrize("series", [1, 2])
def test_a_file_has_the_absolute_outputs_of_memory_to_the_bit_and_is_continued(tmp_path, series):
    pytest.importorskip("h5py")
    rng = np.random.default_rng(series)
    for k in range(5):
        quake = pm.BaseAcceleration(
            rng.normal(size=(40, series)), rng.normal(size=(3, series)), dt=0.013
        )
        s = pm.Subdomain(np.ones(3), np.full(3, 50.0), scheme=pm.Newmark(), name="a", force=quake)
        filed, memory = pm.Coupler([s], dt=0.01), pm.Coupler([s], dt=0.01)
        outputs = {"outputs": {"a": {"A": {"absolute a": np.eye(3), "absolute u": np.eye(3)}}}}
        path = tmp_path / f"{k}.h5"
        for append in (False, True):
            x = filed.run(steps=7, record_to=path, append=append, **outputs)["a"].outputs["A"]
        y = memory.run(steps=14, **outputs)["a"].outputs["A"]
        np.testing.assert_array_equal(x, y)


def test_absolute_outputs_without_a_ground_motion_are_refused():
    for force in (None, np.ones(1)):
        s = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), force=force, name="a")
        with pytest.raises(ValueError, match="absolute outputs of 'a' need a BaseAccelera"):
            pm.Coupler([s], dt=0.1).run(steps=1, outputs={"a": {"x": {"absolute a": [1.0]}}})
    with pytest.raises(ValueError, match="got keys .*; 'absolute a' and so on add"):
        pm.Coupler([s], dt=0.1).run(steps=1, outputs={"a": {"x": {"absolute": [1.0]}}})
