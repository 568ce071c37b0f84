"""Limits of a specimen: what it is commanded, and what it returns."""

import pickle

import numpy as np
import pytest
from pairwise import pairwise

import pmalpha as pm
from pmalpha.rig import Limits

H = 0.01
CENTRAL = pm.CentralDifference()


class Specimen:
    """A spring with a delay in steps, that keeps its commands."""

    def __init__(self, k=4.0, delay=0):
        self.k, self.delay, self.commands = k, delay, []

    def __call__(self, t, u, v):
        self.commands.append((t, *u, *v))
        late = max(0, len(self.commands) - 1 - self.delay)
        return self.k * np.array(self.commands[late][1:2])

    @property
    def table(self):
        return np.array(self.commands).T


def made(specimen, limits, *, scheme=None, substeps=1, **options):
    options = options or dict(v0=[1.0])
    options |= dict(scheme=scheme or CENTRAL, substeps=substeps, name="rig")
    mass = pm.Subdomain([1.0], None, restoring=specimen, limits=limits, **options)
    return pm.Coupler([mass], dt=substeps * H, coupling="gc")


def ended(coupler, t_end=4.0):
    with pytest.raises(pm.LimitError) as caught:
        coupler.run(t_end)
    return caught.value


def test_no_command_beyond_the_displacement_is_given():
    specimen = Specimen()
    coupler = made(specimen, Limits(displacement=0.3), substeps=4)
    error = ended(coupler)
    t, u, _ = specimen.table
    assert np.abs(u).max() <= 0.3 < abs(error.value)
    found = error.subdomain, error.quantity, error.dof, error.limit
    assert found == ("rig", "displacement", 0, 0.3)
    assert error.time == pytest.approx(t[-1] + H)
    # sin(2 t) / 2 = 0.3, and the step of the scheme on top
    assert error.time == pytest.approx(np.arcsin(0.6) / 2.0, abs=1.5 * H)
    assert coupler.time == pytest.approx(np.floor(error.time / (4 * H) - 1e-9) * 4 * H)
    assert coupler.last_history["rig"].t[-1] == pytest.approx(coupler.time)
    assert str(error) == str(pickle.loads(pickle.dumps(error)))


def test_a_run_taken_up_after_a_breach_ends_at_the_same_command():
    specimen = Specimen()
    coupler = made(specimen, Limits(velocity=0.9, acceleration=1e3), substeps=4)
    first, again = ended(coupler), ended(coupler)
    assert (first.value, first.time) == (again.value, again.time)


@pytest.mark.parametrize("scheme", [None, pm.GeneralizedAlpha(0.6, explicit=True), pm.Newmark()])
@pytest.mark.parametrize(("name", "order"), [("velocity", 1), ("acceleration", 2)])
def test_rates_and_accelerations_are_those_of_the_commands(scheme, name, order):
    # let go at u = 1, |v| grows from 0 to 2; pushed at v = 1, |a| from 0 to 2
    specimen = Specimen()
    options = dict(u0=[1.0]) if order == 1 else dict(v0=[1.0])
    error = ended(made(specimen, Limits(**{name: 1.5}), scheme=scheme, **options))
    rates = np.abs(np.diff(specimen.table[1], order)) / H**order
    assert error.quantity == name and abs(error.value) > 1.5
    assert rates.max() <= 1.5 * (1.0 + 1e-9)  # the difference of numbers of size 1, over h^2
    assert rates.max() > 1.4  # it had come near: in a step it changes by 0.04 at most


def test_the_velocity_that_is_given_is_limited_too():
    specimen = Specimen()
    error = ended(made(specimen, Limits(velocity=1.5), u0=[1.0]))
    assert error.quantity == "velocity" and np.abs(specimen.table[2]).max() <= 1.5


@pytest.mark.parametrize(
    ("scheme", "name", "others"),
    pairwise(
        [CENTRAL, pm.Newmark()],
        ["displacement", "velocity"],
        [[], [pm.CubicSpring([0], 1.0, 0.0)]],
    ),
)
def test_what_a_compensator_makes_of_a_command_is_limited(scheme, name, others):
    order = ["displacement", "velocity"].index(name)
    # u = sin(2 t) / 2 grows: 0.1 ahead a command is larger by the motion in that time
    specimen = Specimen()
    compensated = [pm.rig.Compensated(specimen, 0.1, order=1), *others]
    limit = (0.4, 1.1)[order]
    options = dict(v0=[1.0]) if order == 0 else dict(u0=[0.65])
    error = ended(made(compensated, Limits(**{name: limit}), scheme=scheme, **options))
    sent = np.abs(np.diff(specimen.table[1], order)) / H**order
    assert error.quantity == name and abs(error.value) > limit
    assert 0.9 * limit < sent.max() <= limit * (1.0 + 1e-9)
    assert error.time == pytest.approx(specimen.table[0][-1] + H)


def test_after_a_failure_the_next_initial_values_are_no_motion_from_there():
    failures = [OSError("no reply")]

    class Failing(Specimen):
        def __call__(self, t, u, v):
            if t > 5.5 * H and failures:
                raise failures.pop()
            return super().__call__(t, u, v)

    specimen = Failing()
    compensated = [pm.rig.Compensated(specimen, 0.1, order=1)]
    coupler = made(compensated, Limits(velocity=1.5), u0=[0.3])
    with pytest.raises(OSError, match="no reply"):
        coupler.run(1.0)
    specimen.commands.clear()
    coupler.reset(u0={"rig": [0.5]})  # within a step that were a rate of 20
    coupler.run(0.2)
    assert specimen.commands[0] == (0.0, 0.5, 0.0)


def test_a_force_beyond_its_limit_ends_the_run():
    specimen = Specimen()
    coupler = made(specimen, Limits(force=1.0))
    error = ended(coupler)
    t, u, _ = specimen.table
    assert error.quantity == "force" and error.value == 4.0 * u[-1] > 1.0 >= 4.0 * u[-2]
    assert error.time == pytest.approx(t[-1]) and coupler.time == pytest.approx(t[-2])


def test_springs_and_iterated_subdomains_have_limits_too():
    free = dict(scheme=CENTRAL, v0=[1.0], restoring=pm.CubicSpring([0], 4.0, 0.0))
    mass = pm.Subdomain([1.0], None, limits=Limits(force=1.0), **free)
    error = ended(pm.Coupler([mass], dt=H, coupling="gc"))
    assert error.quantity == "force" and 1.0 < error.value < 1.1
    specimen = Specimen(2.0)
    how = dict(restoring_stiffness=[2.0], internal=pm.CubicSpring([0], 2.0, 0.0), v0=[1.0])
    error = ended(made(specimen, Limits(displacement=0.3), scheme=pm.Newmark(), **how))
    assert error.quantity == "displacement" and np.abs(specimen.table[1]).max() <= 0.3


def test_limits_are_those_of_each_dof_in_the_users_order():
    how = dict(restoring=lambda t, u, v: 0.0 * u, limits=Limits(displacement=[np.inf, 0.2, 0.4]))
    a = pm.Subdomain(np.ones(3), 4.0 * np.eye(3), scheme=CENTRAL, v0=np.ones(3), **how)
    b = pm.Subdomain([1.0], [4.0], scheme=CENTRAL, v0=[1.0], name="b")
    error = ended(pm.Coupler([a, b], pm.tie(a, [0], b, [0]), dt=H, coupling="gc"))
    assert (error.dof, error.limit) == (1, 0.2)


def test_initial_values_beyond_the_limits_are_not_commanded():
    specimen = Specimen()
    coupler = made(specimen, Limits(displacement=0.3), u0=[0.5])
    error = ended(coupler)
    assert (error.time, error.value, specimen.commands) == (0.0, 0.5, [])
    coupler.reset(u0={"rig": [0.1]})
    coupler.run(4.0)


@pytest.mark.parametrize("delay", [1, 5])
def test_a_loop_that_lags_is_ended_by_the_energy_that_it_gains(delay):
    # the delay tau is a damper - k tau: the energy 1/2 grows as exp(k tau t), and what it gains is
    # what the specimen returns, seen once in each half cycle, when the spring is released
    specimen = Specimen(k=4.0, delay=delay)
    error = ended(made(specimen, Limits(energy=0.3)), 30.0)
    assert error.quantity == "energy" and error.dof is None and 0.3 < error.value < 0.4
    assert error.time == pytest.approx(np.log(1.6) / (4.0 * delay * H), abs=np.pi / 2.0)
    made(Specimen(), Limits(energy=0.01)).run(8.0)


def test_after_a_reset_the_energy_is_counted_from_there():
    specimen = Specimen(delay=3)
    coupler = made(specimen, Limits(energy=0.3))
    first = ended(coupler, 30.0)
    coupler.reset()
    specimen.commands.clear()
    assert ended(coupler, 30.0).time == pytest.approx(first.time)


def test_limits_do_not_change_a_run():
    wide = Limits(displacement=9.0, velocity=9.0, acceleration=99.0, force=99.0, energy=99.0)
    runs = [made(Specimen(), x, substeps=4).run(2.0)["rig"].u for x in (None, wide)]
    assert np.array_equal(*runs)


def test_cases_with_limits_end_as_single_runs():
    spring = pm.CubicSpring([0], 4.0, 0.0)
    coupler = made(spring, Limits(force=1.0))
    cases = [dict(v0={"rig": [v]}) for v in (0.1, 0.2, 0.3, 1.0)]
    with pytest.raises(pm.CasesError) as caught:
        coupler.run_each(cases, 2.0)
    assert list(caught.value.failures) == [3]
    assert isinstance(caught.value.failures[3], pm.LimitError)


@pytest.mark.parametrize(
    ("limits", "error", "match"),
    [
        (dict(), TypeError, "Limits needs one of displacement"),
        (dict(displacement=0.0), ValueError, "displacement must be positive, got 0.0"),
        (dict(velocity=[1.0, -1.0]), ValueError, "velocity must be positive, got -1"),
        (dict(force=[1.0, np.nan]), ValueError, "force must be positive, got nan"),
        (dict(acceleration="much"), TypeError, "acceleration must be"),
        (dict(energy=-1.0), ValueError, "energy must be positive"),
    ],
)
def test_limits_are_positive_numbers(limits, error, match):
    with pytest.raises(error, match=match):
        Limits(**limits)


def test_limits_need_a_specimen_of_their_size():
    with pytest.raises(ValueError, match="limits must come with a restoring force"):
        pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), limits=Limits(force=1.0))
    with pytest.raises(ValueError, match=r"limits: force must .* shape \(1,\), got \(2,\)"):
        made(Specimen(), Limits(force=[1.0, 2.0]))
    with pytest.raises(TypeError, match="limits must be of type pmalpha.rig.Limits, got 3.0"):
        made(Specimen(), 3.0)


@pytest.mark.parametrize("springs", [False, True])
@pytest.mark.parametrize("scheme", [CENTRAL, pm.Newmark()])
def test_the_force_at_the_initial_values_is_within_the_limits_too(springs, scheme):
    """Of 4 u in a function and, if there is one, 5 u in a spring, at u = 1."""
    k = 9.0 if springs else 4.0
    of_function = Specimen()
    specimen = [pm.CubicSpring(0, 5.0, 0.0), of_function] if springs else of_function
    options = dict(u0=[1.0], scheme=scheme)
    error = ended(made(specimen, Limits(force=k - 0.1), **options))
    assert (error.quantity, error.dof, error.value, error.time) == ("force", 0, k, 0.0)
    assert len(of_function.commands) == 1
    assert made(specimen, Limits(force=k + 0.1), **options).run(steps=3)["rig"].t.size == 4


def test_the_work_of_the_first_substep_counts():
    """A specimen that pulls with 1 along its motion returns the distance: 0.1 from the start on;
    also where a run begins anew."""
    for _ in range(2):
        coupler = made(lambda t, u, v: -np.ones(1), Limits(energy=0.1), v0=[1.0])
        for _ in range(2):
            error = ended(coupler)
            u = coupler.last_history["rig"].u[:, 0]
            assert error.quantity == "energy" and error.value > 0.1
            # u = t + t^2 / 2 by the steps of the central difference; the command after the last one
            assert error.value == pytest.approx(error.time + 0.5 * error.time**2, rel=1e-12)
            assert u[-1] <= 0.1
            coupler.reset()
