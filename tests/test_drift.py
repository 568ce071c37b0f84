"""Ties that part in the first steps: the stiff driven part of Bathe and Noh."""

import numpy as np
import pytest

import pmalpha as pm


def driven(coupling, *, v0=0.0, name=""):
    """A spring of 1e7 whose end follows sin 2t, beside one of 1, from rest or not."""
    K = 1e7 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiff = pm.Subdomain([1.0, 0.5], K, scheme=pm.GeneralizedAlpha(0.5), v0=[2.0, v0], name="stiff")
    soft = pm.Subdomain(
        [0.5, 1.0],
        [[1.0, -1.0], [-1.0, 1.0]],
        scheme=pm.CentralDifference(),
        v0=[v0, 0.0],
        name="soft",
    )
    end = pm.Constraint({stiff: [[1.0, 0.0]]}, velocity=lambda t: [2.0 * np.cos(2.0 * t)])
    return pm.Coupler(
        [stiff, soft], [end, pm.tie(stiff, [1], soft, [0])], dt=0.05, coupling=coupling
    )


def error(history):
    """Of the middle mass on the soft side, which moves as the end: sin 2t."""
    return np.abs(history["soft"].u[:, 0] - np.sin(2.0 * history["soft"].t)).max()


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_start_that_the_step_does_not_resolve_is_named_with_the_gap_it_leaves(coupling):
    text = r"'stiff' and 'soft' have parted by 0.\d+ .*row 1 .* coupling=\"mean\", which has no"
    with pytest.warns(pm.AccuracyWarning, match=text):
        history = driven(coupling).run(10.0)
    assert error(history) > 0.1


def test_mean_coupling_and_the_right_start_are_right_and_silent():
    for history in (driven("mean").run(10.0), driven("gc", v0=2.0).run(10.0)):
        # (omega dt)^2 / 12 of the motion, omega = 2, and the share of the scheme
        assert error(history) < 5e-3
        assert not history.warnings


def test_a_run_of_few_steps_or_not_from_the_start_is_not_judged():
    coupler = driven("gc")
    assert not coupler.run(2.0).warnings
    assert not coupler.run(12.0).warnings


@pytest.mark.parametrize("factor, amplitude", [(1e-3, 0.5), (1.0, 0.5), (1e3, 100.0)])
def test_a_gap_is_judged_by_the_whole_motion_and_not_by_the_factors_of_its_row(factor, amplitude):
    # beside two masses that are tied to each other alone; the gap is 0.3
    made = driven("gc")
    stiff, soft = made.subdomains
    scheme = pm.GeneralizedAlpha(0.9)
    far, away = (pm.Subdomain([1.0], [1.0], scheme=scheme, u0=[amplitude]) for _ in range(2))
    end = pm.Constraint({stiff: [[1.0, 0.0]]}, velocity=lambda t: [2.0 * np.cos(2.0 * t)])
    tie = pm.Constraint({stiff: [[0.0, factor]], soft: [[-factor, 0.0]]})
    constraints = [end, tie, pm.tie(far, [0], away, [0])]
    coupler = pm.Coupler([stiff, soft, far, away], constraints, dt=0.05, coupling="gc")
    if amplitude < 1.0:
        with pytest.warns(pm.AccuracyWarning, match="have parted"):
            coupler.run(10.0)
    else:  # 0.3 per cent of the motion
        assert not coupler.run(10.0).warnings


def test_a_run_of_which_not_all_is_recorded_is_not_judged():
    assert not driven("gc").run(10.0, record={"stiff": [1]}).warnings


def test_of_a_run_that_grows_only_its_step_is_named():
    def coupler(k):
        """A chain of highest frequency sqrt(2 k), which central difference takes to k = 800."""
        K = k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        scheme = pm.CentralDifference()
        chain = pm.Subdomain([1.0, 1.0], K, scheme=scheme, v0=[1.0, 0.0], name="chain")
        soft = pm.Subdomain([1.0], [1.0], scheme=pm.GeneralizedAlpha(0.9), name="soft")
        return pm.Coupler([chain, soft], pm.tie(chain, [1], soft, [0]), dt=0.05, coupling="pm")

    with pytest.warns(pm.AccuracyWarning, match="'chain' and 'soft' have parted"):
        coupler(790.0).run(steps=100)
    with pytest.warns(pm.StabilityWarning, match="'chain' is above its critical step"):
        growing = coupler(800.3)
    history = growing.run(steps=100)
    first = np.abs(history.displacement_jump[:11]).max()
    assert first > 0.1 * np.abs(history["chain"].u).max()  # the gap alone would have been named
    assert not history.warnings


def way(velocity, times):
    """The integral of a velocity by the trapezoidal rule."""
    v = np.array([velocity(t)[0] for t in times])
    return np.append(0.0, np.cumsum(0.5 * np.diff(times) * (v[:-1] + v[1:])))


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_the_jump_of_a_support_is_relative_to_its_displacement(coupling):
    coupler = driven(coupling, v0=2.0)
    history = coupler.run(10.0)
    at = history.macro_times
    jump = history.displacement_jump[:, 0]
    support = way(lambda t: [2.0 * np.cos(2.0 * t)], at)
    # sums of 200 terms of at most 0.1
    np.testing.assert_allclose(jump, history["stiff"].u[:, 0] - support, rtol=0, atol=1e-14)
    assert np.abs(history["stiff"].u).max() > 0.99
    # the way is 1: the drift of "pm" is 5e-3 in these 200 steps; "mean" has none
    assert np.abs(jump).max() < (1e-13 if coupling == "mean" else 0.01)
    # the integral goes on where the run does
    np.testing.assert_array_equal(coupler.run(steps=1).displacement_jump[0, 0], jump[-1])


def shaken(substeps=1, **options):
    """A mass between a support that moves and one that is held at a millimetre, uncut and beside
    a mass with substeps; by the trapezoidal rule, which moves a support by the mean velocity."""
    K = [[9.0, -9.0, 0.0], [-9.0, 18.0, -9.0], [0.0, -9.0, 9.0]]
    u0 = [0.0, 0.0, 1e-3]
    frame = pm.Subdomain([0.1, 1.0, 0.1], K, scheme=pm.Newmark(), u0=u0, name="frame")
    rig = pm.Subdomain([1.0], [30.0], scheme=pm.Newmark(), substeps=substeps, name="rig")
    rows = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    ends = pm.Constraint({frame: rows}, velocity=lambda t: [2.0 * np.sin(5.0 * t), 0.0])
    tie = pm.tie(frame, [1], rig, [0])
    return pm.Coupler([frame, rig], [ends, tie], dt=0.02, **options)


@pytest.mark.parametrize(
    "coupling", ["gc", "macro", "mean"]
)  # "pm" takes steps of twice the length
def test_supports_that_the_trapezoidal_rule_moves_have_no_drift(coupling, tmp_path):
    coupler, other = shaken(coupling=coupling), shaken(coupling=coupling)
    history = coupler.run(steps=100)
    assert np.abs(history["frame"].u[:, 0]).max() > 0.7  # 0.8 is the way
    jumps = [history.displacement_jump]
    coupler.save(tmp_path / "at.npz")
    other.load(tmp_path / "at.npz")
    whole = coupler.run(steps=50)
    np.testing.assert_array_equal(other.run(steps=50).displacement_jump, whole.displacement_jump)
    coupler.change_steps(dt=0.01)
    jumps += [whole.displacement_jump, coupler.run(steps=50).displacement_jump]
    other.reset()
    jumps.append(other.run(steps=50).displacement_jump)
    for jump in jumps:
        # 250 roundings of displacements below 1
        assert np.abs(jump[:, 0]).max() < 1e-13
        assert np.abs(jump[:, 1] - 1e-3).max() < 1e-13  # held where it began
    np.testing.assert_array_equal(jumps[-1], jumps[0][:51])


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("coupling", ["gc", "pm"])
def test_with_substeps_a_support_is_followed_over_fine_steps(coupling, threads):
    history = shaken(4, coupling=coupling, threads=threads).run(steps=100)
    support = way(lambda t: [2.0 * np.sin(5.0 * t)], history.multiplier_times)[::4]
    expected = history["frame"].u[:, 0] - support
    # sums of 400 terms; steps of h = 0.02, of "pm" 0.04, leave h^2 / 12 of the change of slope, 20
    np.testing.assert_allclose(history.displacement_jump[:, 0], expected, rtol=0, atol=1e-14)
    assert 1e-5 < np.abs(expected).max() < 3e-3
    table = history.to_xarray()["displacement_jump"]
    np.testing.assert_array_equal(table, history.displacement_jump)


def test_a_step_that_fails_does_not_move_the_support_twice():
    class Failing:
        fails = False

        def __call__(self, t, u, v):
            if self.fails and t > 0.35:
                raise RuntimeError("no")
            return 0.0 * u

    def made(function):
        K = [[9.0, -9.0], [-9.0, 9.0]]
        a = pm.Subdomain([1.0, 1.0], K, scheme=pm.Newmark(), restoring=function)
        b = pm.Subdomain([1.0], [9.0], scheme=pm.Newmark(), substeps=3)
        end = pm.Constraint({a: [[1.0, 0.0]]}, velocity=lambda t: [np.sin(t)])
        return pm.Coupler([a, b], [end, pm.tie(a, [1], b, [0])], dt=0.1, coupling="gc")

    function = Failing()
    coupler, other = made(function), made(lambda t, u, v: 0.0 * u)
    function.fails = True
    with pytest.raises(RuntimeError):
        coupler.run(1.0)
    function.fails = False
    coupler.step(2)
    other.step(coupler.step_count)
    np.testing.assert_array_equal(
        coupler.run(steps=5).displacement_jump, other.run(steps=5).displacement_jump
    )
