"""Internal forces that fail: the state is that of the last macro step, and the run goes on."""

import functools
import re

import numpy as np
import pytest
from newton_coupled import VARIANTS, Law, plastic_pair, same_bits, state_of
from pairwise import in_turn

import pmalpha as pm

pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

STEPS = 8


class Broken(Exception):
    pass


def made(variant, threads=None, tangent="full", **options):
    """The coupler and the laws of a and b."""
    laws = Law(5), Law(5, k=3e3)
    newton = pm.Newton(tangent=tangent)
    return plastic_pair(variant, laws=laws, newton=newton, threads=threads, **options), laws


@functools.cache
def undisturbed(variant, **options):
    """The run, its state after each macro step, and the evaluations of each law up to it."""
    c, laws = made(variant, **options)
    states, calls = [], []
    c.run(steps=0)
    for _ in range(STEPS):
        states.append(state_of(c))
        calls.append([law.calls for law in laws])
        c.step()
    states.append(state_of(c))
    return made(variant, **options)[0].run(steps=STEPS), states, calls


def raises(error):
    def action(*args):
        raise error

    return action


# What an evaluation does instead, the exception that the caller sees, and its text.
FAILURES = {
    "an exception": (raises(Broken("at its end")), Broken, "at its end"),
    "Ctrl-C": (raises(KeyboardInterrupt()), KeyboardInterrupt, "^$"),
    "no tuple": (lambda t, u, v, q: u, TypeError, "internal of subdomain '.' at t = .* tuple"),
    "a wrong shape": (lambda t, u, v, q: (u[:2], u, u, q), ValueError, "f must have shape"),
    "a wrong history": (lambda t, u, v, q: (u, u, u, q[:3]), ValueError, "q1 must have shape"),
    "no history": (lambda t, u, v, q: (u, u, u), ValueError, "q1 must be returned"),
}


@pytest.mark.gate
@pytest.mark.parametrize(
    ("variant", "side", "failure"),
    [(list(VARIANTS)[i % 4], (i + i // 4) % 2, failure) for i, failure in enumerate(FAILURES)],
)
def test_a_failure_in_any_iteration_leaves_the_last_macro_step(variant, side, failure):
    action, error, text = FAILURES[failure]
    history, states, calls = undisturbed(variant)
    rng = np.random.default_rng(len(failure) + side)
    k = rng.integers(calls[0][side] + 1, calls[-1][side])
    c, laws = made(variant)
    laws[side].at, laws[side].action = k, action
    with pytest.raises(error, match=text):
        c.run(steps=STEPS)
    done = c.step_count
    assert calls[done][side] < k <= calls[done + 1][side]
    assert state_of(c) == states[done]
    # what was recorded up to there is kept
    if done:
        kept = c.last_history["b"].u
        np.testing.assert_array_equal(kept, history["b"].u[: len(kept)])
    c.step(STEPS - done)
    assert state_of(c) == states[-1]


@pytest.mark.parametrize("stride", [9, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize(
    ("variant", "threads", "tangent"),
    list(zip(VARIANTS, [1, 3, 1, 3], ["full", "reuse", "reuse", "full"])),
)
def test_all_iterations_of_a_macro_step_may_fail_one_by_one(variant, threads, tangent, stride):
    # with any number of threads, and whatever tangents are kept
    _, states, calls = undisturbed(variant, tangent=tangent)
    c, laws = made(variant, threads, tangent)
    c.step(3)
    before = laws[1].calls
    for k in range(1, calls[4][1] - calls[3][1] + 1, stride):
        laws[1].at, laws[1].action = laws[1].calls + k, raises(Broken())
        with pytest.raises(Broken):
            c.step()
        assert c.step_count == 3 and state_of(c) == states[3]
    assert laws[1].calls > before
    c.step(STEPS - 3)
    assert state_of(c) == states[-1]


class Spoiled(Law):
    """Not a number after a time, from evaluation `begins` at a time level on; None: never."""

    begins, last = None, (0.0, 0)

    def __call__(self, t, u, v, q):
        self.last = (t, self.last[1] + 1 if t == self.last[0] else 0)
        f, K_t, C_t, q1 = super().__call__(t, u, v, q)
        spoils = self.begins is not None and t > 0.13 and self.last[1] >= self.begins
        return (np.nan * f if spoils else f), K_t, C_t, q1


@pytest.mark.parametrize(
    ("variant", "tangent", "begins"),
    list(zip(VARIANTS, ["full", "reuse", "reuse", "full"], [0, 1, 0, 1])),
)
def test_values_that_are_not_finite_end_the_run(variant, tangent, begins):
    _, states, _ = undisturbed(variant, tangent=tangent)
    laws = Law(5), Spoiled(5, k=3e3)
    c = plastic_pair(variant, laws=laws, newton=pm.Newton(tangent=tangent))
    laws[1].begins = begins
    words = "internal of subdomain 'b' returned f.0. = nan at t = 0.1"
    with pytest.raises(pm.ConvergenceError, match=words) as caught:
        c.run(steps=STEPS)
    assert caught.value.subdomain == "b" and caught.value.iterations >= begins
    assert 0.12 <= caught.value.time <= 0.14 + 1e-9  # dt = 0.02
    assert c.step_count == 6 and state_of(c) == states[6]
    laws[1].begins = None
    c.step(STEPS - 6)
    assert state_of(c) == states[-1]


CALLS = {
    "step": lambda c: c.step(),
    "run": lambda c: c.run(steps=1),
    "state": lambda c: c.state("a"),
    "reset": lambda c: c.reset(),
    "multipliers": lambda c: c.multipliers,
}


@pytest.mark.parametrize(("name", "variant"), in_turn(CALLS, *VARIANTS))
def test_the_coupler_may_not_be_used_by_the_force_that_it_evaluates(name, variant):
    _, states, calls = undisturbed(variant)
    c, laws = made(variant)
    laws[0].at, laws[0].action = calls[2][0] + 2, lambda *args: CALLS[name](c)
    with pytest.raises(RuntimeError, match="being stepped"):
        c.run(steps=STEPS)
    assert c.step_count == 2 and state_of(c) == states[2]
    c.step(STEPS - 2)
    assert state_of(c) == states[-1]


@pytest.mark.gate
def test_a_force_may_run_another_coupler():
    _, states, _ = undisturbed("pm")
    inner, _ = made("macro")

    class Nested(Law):
        def __call__(self, t, u, v, q):
            if t > 0.0 and inner.step_count < 5:
                inner.step()
            return super().__call__(t, u, v, q)

    c = plastic_pair("pm", laws=(Nested(5), Law(5, k=3e3)))
    c.step(STEPS)
    assert state_of(c) == states[-1] and inner.step_count == 5
    expected, _ = made("macro")
    expected.step(5)
    assert state_of(inner) == state_of(expected)


@pytest.mark.gate
@pytest.mark.parametrize(("variant", "threads"), [("pm", 2), ("macro", 1)])
def test_ctrl_c_at_any_time_loses_no_whole_step(variant, threads, interrupt):
    _, states, _ = undisturbed(variant)
    c, _ = made(variant, threads)
    rng, interrupted = np.random.default_rng(4), 0
    while c.step_count < STEPS:
        try:
            interrupt(rng.uniform(5e-4, 5e-3) * (1 + interrupted))
            c.run(steps=STEPS - c.step_count)
            interrupt(0.0)
        except KeyboardInterrupt:
            interrupted += 1
            if c.step_count:  # before that it need not have begun
                assert state_of(c) == states[c.step_count]
    assert interrupted > 0
    assert state_of(c) == states[-1]


# ---- tangents -------------------------------------------------------------------------------


def stiff_chain(t, u, v, q, wrong=1.0):
    """Cubic springs between four dofs and the ground; a factor of one entry of K_t."""
    B = np.eye(4) - np.eye(4, k=-1)
    d = B @ u
    K = B.T @ np.diag(1e4 + 3e6 * d**2) @ B
    K[2, 2] *= wrong
    return B.T @ (1e4 * d + 1e6 * d**3), K


def coupled_chains(coupling, law, **newton):
    common = dict(scheme=pm.GeneralizedAlpha(0.5), v0=[0.0, 0.0, 0.2, 0.0])
    a = pm.Subdomain(np.ones(4), None, internal=law, double_step=False, name="rig", **common)
    b = pm.Subdomain(np.ones(4), None, internal=stiff_chain, name="frame", **common)
    tie = pm.tie(a, [3], b, [3])
    return pm.Coupler([a, b], tie, dt=0.1, coupling=coupling, newton=pm.Newton(**newton))


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_wrong_tangent_is_slow_and_then_an_error_that_leads_to_the_check(coupling):
    right = coupled_chains(coupling, stiff_chain).run(steps=3)
    little, much = (functools.partial(stiff_chain, wrong=x) for x in (1.2, 8.0))

    slow = coupled_chains(coupling, little).run(steps=3)
    assert slow["rig"].iterations.sum() > 1.3 * right["rig"].iterations.sum()
    # the same solution: tol 1e-8 of the motion, in energy
    assert abs(slow["rig"].u - right["rig"].u).max() < 1e-5 * abs(right["rig"].u).max()
    c = coupled_chains(coupling, much)
    with pytest.raises(pm.ConvergenceError, match="InternalForce.check") as caught:
        c.run(steps=3)
    assert caught.value.iterations == 40
    assert caught.value.subdomain in ("rig", "frame")  # they iterate together
    report = pm.InternalForce(much).check([0.1, 0.3, 0.2, 0.4])
    assert (report.matrix, report.row, report.column) == ("K_t", 2, 2)
    assert "in the column of dof 2" in str(report)
    # what was recorded before it, and the state, are there
    assert c.step_count < 3 and np.isfinite(c.state("rig").u).all()


@pytest.mark.parametrize(
    ("coupling", "tangent"), [("gc", "full"), ("pm", "reuse"), ("macro", "full")]
)
def test_a_singular_tangent_is_named_with_its_dof(coupling, tangent):
    class Column:
        """Four lateral springs, and from t = 0.5 on a coupling so strong that mass is rounding."""

        grows = True

        def __call__(self, t, u, v, q):
            K = 1e5 * np.diag([4.0, 4.0, 1.0, 4.0])
            if self.grows and t > 0.5:
                K[1:3, 1:3] = 1e25
            return K @ u, K

    def column_run():
        column = Column()
        scheme = pm.GeneralizedAlpha(0.5)
        v0 = [0.0, 0.0, 1e-3, 0.0]
        a = pm.Subdomain(np.ones(4), None, scheme=scheme, internal=column, v0=v0, name="column")
        b = pm.Subdomain(np.ones(2), [1e4, 1e4], scheme=scheme, double_step=False, name="frame")
        tie = pm.tie(a, [1], b, [0])
        newton = pm.Newton(tangent=tangent)
        return pm.Coupler([a, b], tie, dt=0.1, coupling=coupling, newton=newton), column

    c, column = column_run()
    # Mbar_t = 1 + al1 K_t: al1 1e25 in all four entries of two dofs, the second pivot is lost
    with pytest.raises(pm.ConvergenceError) as caught:
        c.run(steps=10)
    error = caught.value
    assert error.subdomain == "column" and 0.5 < error.time <= 0.7
    assert re.search("Mbar is singular but for rounding, first seen at dof [12], ", error.cause)
    # and goes on as if nothing had happened
    done, state = c.step_count, state_of(c)
    with pytest.raises(pm.ConvergenceError):
        c.step()
    assert state_of(c) == state
    column.grows = False
    c.step(3)
    assert c.step_count == done + 3 and np.isfinite(c.state("column").u).all()


@pytest.mark.gate
@pytest.mark.parametrize("variant", ["gc", "macro, double step"])
def test_a_coupler_that_has_failed_may_be_reset(variant):
    history, _, _ = undisturbed(variant)
    c, laws = made(variant)
    laws[0].at, laws[0].action = 40, raises(Broken())
    with pytest.raises(Broken):
        c.run(steps=STEPS)
    c.reset()
    same_bits(c.run(steps=STEPS), history)


@pytest.mark.parametrize("ss", [(1, 1), (1, 4), (4, 1)])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_a_tangent_that_is_lost_is_a_convergence_error_and_nothing_is_committed(coupling, ss):
    B = np.eye(3) - np.eye(3, k=-1)

    def law(t, u, v, q):
        k = 1e6 if t < 0.43 else 0.0  # of three springs in a row, which stay as they are
        return 1e6 * (B.T @ B @ u), k * B.T @ B

    alpha = pm.GeneralizedAlpha(0.5)
    rig = pm.Subdomain(
        np.ones(3), None, scheme=alpha, internal=law, v0=[0.0, 1.0, 0.0], substeps=ss[0], name="rig"
    )
    frame = pm.Subdomain([1.0, 1.0], [1e3, 1e3], scheme=alpha, substeps=ss[1], name="frame")
    tie = pm.tie(rig, [2], frame, [0])
    c = pm.Coupler([rig, frame], tie, dt=0.05, coupling=coupling)
    with pytest.raises(pm.ConvergenceError) as caught:
        c.run(0.6)
    assert caught.value.subdomain == "rig" and 0.43 < caught.value.time <= 0.45 + 1e-9
    assert caught.value.iterations > 0
    # the macro step from 0.4 to 0.45 has not been made
    assert c.step_count == 8 and abs(c.state("rig").u).max() < 1.0
    np.testing.assert_array_equal(c.last_history["rig"].u[-1], c.state("rig").u)
    assert c.last_history["rig"].t[-1] == pytest.approx(0.4, abs=1e-12)


@pytest.mark.parametrize("ss", [(1, 1), (1, 4), (4, 1)])
@pytest.mark.parametrize("coupling", ["gc", "pm", "macro", "mean"])
def test_a_run_with_a_lost_tangent_beside_a_linear_subdomain_is_right_or_ends(coupling, ss):
    """A line search finds equilibrium along a correction of which the linear side has the whole."""

    def run(lost):
        def law(t, u, v, q):
            return 1e6 * u, (0.0 if lost and t > 0.43 else 1e6) * np.eye(3)

        start = dict(u0=[1e-3] * 3, v0=[1.0, 2.0, 3.0], scheme=pm.GeneralizedAlpha(0.8))
        rig = pm.Subdomain(
            np.ones(3), None, internal=law, substeps=ss[0], double_step=False, name="rig", **start
        )
        frame = pm.Subdomain(
            np.ones(3), [100.0] * 3, force=[1.0, 2.0, 3.0], substeps=ss[1], name="frame", **start
        )
        ties = pm.tie(rig, [0, 1, 2], frame, [0, 1, 2])
        c = pm.Coupler([rig, frame], ties, dt=0.05, coupling=coupling)
        try:
            return c.run(0.6)
        except pm.ConvergenceError:
            assert c.step_count == 8  # the macro step from 0.4 to 0.45 has not been made
            return c.last_history

    right, found = run(False), run(True)
    for name in ("rig", "frame"):
        u, expected = found[name].u, right[name].u
        # macro and mean close the constraints to 1e-8 of the motion, in energy
        assert abs(u - expected[: len(u)]).max() < 1e-3 * abs(expected).max()


# ---- tangents that are far too large, or not finite ----------------------------------------------


def beside_another(coupling, tangent, k_t, other=None):
    """A mass on K = 4 and f = 4 u, with the tangent k_t(t), tied to another one."""

    def force(t, u, v, q):
        return 4.0 * u, [[k_t(t)]]

    a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[1.0], internal=force, name="a")
    newton = pm.Newton(tangent=tangent)
    if coupling == "alone":
        return pm.Coupler([a], dt=0.05, newton=newton)
    b = pm.Subdomain([1.0], [8.0], scheme=pm.Newmark(), v0=[1.0], internal=other, name="b")
    ties = pm.tie(a, [0], b, [0])
    return pm.Coupler([a, b], ties, dt=0.05, coupling=coupling, newton=newton)


@pytest.mark.parametrize("tangent", ["full", "reuse"])
@pytest.mark.parametrize("coupling", ["alone", "gc", "pm", "macro", "mean"])
def test_a_tangent_that_is_far_too_large_is_an_error_and_no_balance(coupling, tangent):
    """It makes corrections, and by (N8) residuals, rounding: the state was accepted as it was
    guessed. Also beside a subdomain that is iterated and right."""
    spring = pm.CubicSpring([0], k=2.0, k3=1.0)
    for wrong in (1e14, 1e18, 1e30, -1e18):
        for other in (None,) if coupling == "alone" else (None, spring):
            coupler = beside_another(coupling, tangent, lambda t, k=wrong: k, other)
            with pytest.raises(pm.ConvergenceError, match="compares the tangents"):
                coupler.step(20)
            assert coupler.step_count == 0
    beside_another(coupling, tangent, lambda t: 4.0).step(20)


@pytest.mark.parametrize("tangent", ["full", "reuse"])
@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_tangent_that_is_not_finite_is_an_error_by_name(value, tangent):
    # at set-up, and in the third step, where only fresh tangents are asked for
    for begins in (0.0, 0.11) if tangent == "full" else (0.0,):

        def k_t(t, begins=begins):
            return value if t >= begins else 4.0

        with pytest.raises((ValueError, pm.ConvergenceError)) as error:
            beside_another("gc", tangent, k_t).step(20)
        assert re.search("internal of subdomain 'a'", str(error.value))
        assert re.search("K_t.*(finite|inf|nan)", str(error.value)), str(error.value)


def test_a_stiff_held_mass_at_rest_under_prestress_is_in_balance():
    """Its tangent of 1e16 is right: the residual that is as large as the forces is rounding."""

    def force(t, u, v, q):
        return 1e16 * (u - 1e-3) + 1e13, [[1e16]]

    a = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), v0=[1e-6], internal=force, name="a")
    x = pm.Coupler([a], dt=0.05).run(steps=20)["a"]
    assert np.abs(x.u).max() < 1e-6
