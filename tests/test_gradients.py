"""Gradients of coupled runs by reversed runs, (A1) to (A14), against differences of the run itself.

A function of second order has exact central differences in what the run is linear in, loads and
initial values; in parameters those of fourth order leave 1e-8.
"""

import numpy as np
import pytest
from agreement import assert_close
from pairwise import in_turn

import pmalpha as pm

STEPS, DT = 14, 0.1
SIZES = (3, 4, 3)
SPRING = np.outer([1.0, -1.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0])
MASS = np.diag([0.1, 0.0, 0.2, 0.0])
CHANGED = pm.Parameters("s1", dofs=[[0, 1, 2, 3]], K=SPRING, C=0.05 * SPRING, M=MASS)
# Rounding of differences of values of size 1e3 from their parts, relative to the gradient.
LINEAR, DIFFERENCES = 1e-10, 1e-6

half, fine = pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.8)
explicit = pm.GeneralizedAlpha(0.8, explicit=True)
trapezoidal = (pm.Newmark(),) * 3
three = (half, pm.Newmark(), pm.GeneralizedAlpha(0.9))


def problem(
    coupling, substeps, schemes, *, theta=0.0, u0=None, v0=None, force=None, g=None, **kind
):
    """Random floating subdomains in a chain; `force` and `g` are added to what there is."""
    rng = np.random.default_rng(1)
    subdomains = []
    for i, (n, s, scheme) in enumerate(zip(SIZES, substeps, schemes)):
        M, B = np.diag(rng.uniform(1.0, 2.0, n)), rng.normal(size=(n, n))
        K = 4.0 * B @ B.T
        C = 0.05 * K + 0.1 * M
        turned = rng.normal(size=(n, n))
        if kind.get("unsymmetric"):
            K, C = K + 0.3 * (turned - turned.T), C + 0.1 * (turned - turned.T)
        F = rng.normal(size=(STEPS * s + 1, n))
        if i == 1:
            K, C, M = K + theta * SPRING, C + 0.05 * theta * SPRING, M + theta * MASS
        subdomains.append(
            pm.Subdomain(
                M.diagonal() if scheme.explicit else M,
                K,
                C=C,
                scheme=scheme,
                substeps=s,
                double_step=True if kind.get("double") and s == 1 else None,
                symmetric=not kind.get("unsymmetric"),
                force=pm.SampledForce(F if force is None else F + force[i], DT / s),
                u0=None if u0 is None else u0[i],
                v0=None if v0 is None else v0[i],
                name=f"s{i}",
            )
        )
    rows = [pm.tie("s0", [0, 1], "s1", [1, 2])]
    if len(substeps) > 2:
        rows.append(pm.tie("s1", [0], "s2", [1]))
    if kind.get("moved"):
        levels = 1 if coupling == "macro" else max(substeps)
        swing = 0.1 * np.sin(0.4 * np.arange(STEPS * levels + 1))[:, None]
        velocity = pm.SampledForce(swing if g is None else swing + g, DT / levels)
        rows.append(pm.Constraint({"s0": [[0.0, 0.0, 1.0]]}, velocity=velocity))
    return pm.Coupler(subdomains, rows, dt=DT, coupling=coupling, threads=1)


def squares(history, multipliers=False, kinds="uva"):
    """Weighted squares of everything that is recorded, and their derivatives."""
    rng = np.random.default_rng(5)
    value, sources = 0.0, {}
    for name, _ in history.keys:
        sources[name] = {}
        for kind in kinds:
            x = getattr(history[name], kind)
            weight, difference = rng.uniform(1.0, 2.0, x.shape), x - rng.normal(size=x.shape)
            value += 0.5 * np.sum(weight * difference**2)
            sources[name][kind] = weight * difference
    if multipliers:
        difference = history.multipliers - rng.normal(size=history.multipliers.shape)
        value += 0.5 * np.sum(difference**2)
        sources["multipliers"] = difference
    return value, sources


# coupling, substeps, schemes, kind, whether multipliers are in the function, macro steps of a block
CASES = [
    ("gc", (1, 1), (half, fine), {}, False, None),
    ("gc", (1, 5), (half, explicit), {}, False, 4),
    ("gc", (1, 2, 4), three, {}, True, None),
    ("gc", (1, 2, 4), (pm.HHT(0.1), pm.WBZ(0.2), pm.Newmark(0.3, 0.6)), {}, True, 3),
    ("gc", (1, 3), (half, fine), {"unsymmetric": True}, False, 4),
    ("gc", (1, 3), (half, fine), {"moved": True}, False, None),
    ("pm", (1, 5), (half, explicit), {}, False, None),
    ("pm", (1, 2, 4), (half, fine, fine), {}, True, 3),
    ("pm", (1, 3), (half, fine), {"unsymmetric": True}, True, None),
    ("pm", (1, 3), (half, fine), {"moved": True}, False, 4),
    ("macro", (2, 3, 7), (half, pm.GeneralizedAlpha(0.3), pm.Newmark()), {}, True, 4),
    ("macro", (1, 5), (half, explicit), {"double": True}, True, 4),
    ("macro", (1, 5, 3), (pm.CentralDifference(), pm.CentralDifference(), fine), {}, False, None),
    ("macro", (1, 3), (half, fine), {"moved": True, "unsymmetric": True}, False, 4),
    ("mean", (1, 3, 4), trapezoidal, {}, False, None),
    ("mean", (2, 3), trapezoidal[:2], {"unsymmetric": True}, False, 4),
]


def assert_slope(got, expected, to, within=LINEAR):
    assert_close(got, expected, within, f"derivative with respect to {to}", size=abs(expected))


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning", "ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize(("coupling", "substeps", "schemes", "kind", "multipliers", "block"), CASES)
def test_a_gradient_is_that_of_the_run(coupling, substeps, schemes, kind, multipliers, block):
    def objective(history):
        return squares(history, multipliers, "uv" if coupling == "mean" else "uva")

    def value(**changed):
        changed = problem(coupling, substeps, schemes, **kind, **changed)
        return objective(changed.run(steps=STEPS))[0]

    def along(name, directions):
        """The derivative of a function of second order, exact but for rounding."""
        back = -directions if name == "g" else [-x for x in directions]
        return (value(**{name: directions}) - value(**{name: back})) / 2.0

    coupler = problem(coupling, substeps, schemes, **kind)
    coupler.step(3)
    found = coupler.gradient(objective, steps=STEPS, parameters=CHANGED, block=block)
    assert coupler.step_count == 3
    assert found.value == value()
    e = 1e-4
    near, far = (value(theta=x) - value(theta=-x) for x in (e, 2.0 * e))
    slope = (8.0 * near - far) / (12.0 * e)
    assert_slope(found.parameters[0][0], slope, "the parameter", DIFFERENCES)

    rng, names = np.random.default_rng(2), [s.name for s in coupler.subdomains]
    u0 = [rng.normal(size=s.n) for s in coupler.subdomains]
    if coupling == "mean":  # which ties displacements
        u0[1][[1, 2]] = u0[0][[0, 1]]
        u0[-1][1] = u0[1][0] if len(u0) > 2 else u0[-1][1]
    expected = along("u0", u0)
    assert_slope(sum(found.u0[k] @ x for k, x in zip(names, u0)), expected, "u0")
    force = [rng.normal(size=found.force[k].shape) for k in names]
    expected = along("force", force)
    total = sum(np.sum(found.force[k] * x) for k, x in zip(names, force))
    assert_slope(total, expected, "the loads")
    if kind.get("moved"):
        g = rng.normal(size=(len(found.velocity), 1))
        g[0] = 0.0  # v0 has to agree with it
        expected = along("g", g)
        assert_slope(np.sum(found.velocity[:, -1:] * g), expected, "the prescribed velocity")
    else:  # equal velocities everywhere satisfy the ties
        v0 = [0.7 * np.ones(s.n) for s in coupler.subdomains]
        expected = along("v0", v0)
        assert_slope(sum(found.v0[k] @ x for k, x in zip(names, v0)), expected, "v0")


def test_without_the_interface_term_a_gradient_under_gc_is_wrong(monkeypatch):
    from pmalpha.gradients.adjoint import Adjoint

    def gradient():
        coupler = problem("gc", (1, 2, 4), three)
        return coupler.gradient(squares, steps=STEPS, parameters=CHANGED).parameters[0]

    exact = gradient()
    monkeypatch.setattr(Adjoint, "of_interface", lambda *a: np.zeros(1))
    assert abs(gradient() / exact - 1.0) > 1e-3


JACOBIANS = [
    ("macro", (1, 5), (half, explicit), {"double": True}),
    ("macro", (1, 3), (half, fine), {"moved": True, "unsymmetric": True}),
    ("gc", (1, 1), (half, explicit), {}),
    ("pm", (1, 1), (half, fine), {}),
    ("mean", (1, 3), trapezoidal[:2], {}),
]


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize(
    ("coupling", "substeps", "schemes", "kind", "what"),
    [(*case, what) for case, what in in_turn(JACOBIANS, "u", "a")],
)
def test_a_jacobian_and_a_gradient_are_of_the_same_run(coupling, substeps, schemes, kind, what):
    """Forward sensitivities times weights are the gradient of the weighted sum; both are exact."""
    diagonals = pm.Parameters("s0", K=[np.eye(3), np.diag([0.0, 1.0, 0.0])])
    sensors = {"s0": [2, 0], "s1": [3]}
    what = "v" if coupling == "mean" and what == "a" else what
    coupler = problem(coupling, substeps, schemes, **kind)
    rng = np.random.default_rng(3)
    weights = {
        name: rng.normal(size=(STEPS * s + 1, len(dofs)))
        for (name, dofs), s in zip(sensors.items(), substeps)
    }

    def weighted(history):
        value, sources = 0.0, {}
        for name, dofs in sensors.items():
            x = getattr(history[name], what)
            sources[name] = {what: np.zeros_like(x)}
            sources[name][what][:, dofs] = weights[name]
            value += np.sum(weights[name] * x[:, dofs])
        return value, sources

    found = coupler.jacobian(sensors, steps=STEPS, parameters=[CHANGED, diagonals], what=what)
    assert found["s0"].shape == (STEPS * substeps[0] + 1, 2, 3)
    forward = sum(np.einsum("ls,lsm->m", weights[name], found[name]) for name in sensors)
    gradient = coupler.gradient(weighted, steps=STEPS, parameters=[CHANGED, diagonals])
    backward = np.concatenate(gradient.parameters)
    assert np.allclose(forward, backward, rtol=0.0, atol=1e-11 * abs(forward).max())


REVERSED = [
    ("macro", (1, 5), (half, explicit), {}),
    ("macro", (2, 3), (half, fine), {"moved": True, "unsymmetric": True}),
    ("gc", (1, 1), (half, explicit), {}),
    ("pm", (1, 1), (pm.CentralDifference(), explicit), {}),
    ("mean", (2, 3), trapezoidal[:2], {}),
]


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning", "ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize(
    ("coupling", "substeps", "schemes", "kind", "what"),
    [(*case, what) for case, what in in_turn(2 * REVERSED, "u", "v", "a")][:8],
)
def test_reversed_runs_and_forward_ones_have_the_same_jacobian(
    thresholds, coupling, substeps, schemes, kind, what
):

    springs = pm.Parameters(
        "s1", dofs=[[0, 1], [2, 3], [1, 3]], K=SPRING[:2, :2], C=0.1 * np.eye(2)
    )
    pair = pm.Parameters("s1", dofs=[[0, 1], [1, 2], [0, 3]], K=np.eye(2), labels=["b", "a", "b"])
    diagonals = pm.Parameters("s0", K=[np.eye(3), np.diag([0.0, 1.0, 0.0])])
    what = "v" if coupling == "mean" and what == "a" else what
    coupler = problem(coupling, substeps, schemes, **kind)
    sensors = {"s0": [2, 0], "s1": [3]}

    def found(advantage):
        thresholds(ADVANTAGE=advantage)
        done = []
        report = lambda count, total: done.append((count, total))  # noqa: E731
        S = coupler.jacobian(
            sensors,
            steps=STEPS,
            parameters=[springs, pair, diagonals],
            what=what,
            progress=report,
        )
        return S, done[-1]

    (forward, of_forward), (backward, of_backward) = found(np.inf), found(0)
    runs = 2 * substeps[0] + substeps[1]
    assert of_forward == (7, 7) and of_backward == (runs, runs)
    for name, S in forward.items():
        assert np.max(abs(S - backward[name])) < 1e-11 * np.max(abs(S))


@pytest.mark.gate
def test_stiffnesses_are_found_again_from_what_was_measured():
    """Gauss-Newton with the Jacobian, from stiffnesses that are wrong by 30 per cent."""
    true = np.array([1000.0, 900.0, 800.0, 700.0])
    sensors = np.array([1, 3])

    def frame(k):
        M, K = pm.models.shear_frame(np.ones(4), k)
        upper = pm.Subdomain(M, K, C=0.002 * K, scheme=fine, name="frame", v0=[0.0, 0.0, 0.0, 1.0])
        return pm.Coupler([upper], dt=0.01)

    springs = [np.zeros((4, 4)) for _ in range(4)]
    for j, D in enumerate(springs):
        D[j, j] += 1.0
        if j > 0:
            D[j - 1, j - 1] += 1.0
            D[[j - 1, j], [j, j - 1]] -= 1.0
    parameters = pm.Parameters("frame", K=springs, C=[0.002 * D for D in springs])
    data = frame(true).run(0.5)["frame"].a[:, sensors]
    misfit = pm.Misfit({"frame": dict(dofs=sensors, a=data)})
    k = true * [1.3, 0.8, 1.2, 0.75]
    first = frame(k).gradient(misfit, 0.5).value
    for _ in range(8):
        S = frame(k).jacobian({"frame": sensors}, 0.5, parameters=parameters)["frame"]
        residual = data - frame(k).run(0.5)["frame"].a[:, sensors]
        k = k + np.linalg.lstsq(S.reshape(-1, 4), residual.ravel(), rcond=None)[0]
    assert np.allclose(k, true, rtol=1e-9)
    last = frame(k).gradient(misfit, 0.5, parameters=parameters)
    assert last.value < 1e-15 * first
    assert abs(last.parameters[0]).max() < 1e-9 * first / 700.0


def test_data_that_are_missing_do_not_count():
    coupler = problem("macro", (1, 2), (half, fine))
    data = np.full((STEPS + 1, 1), np.nan)
    data[3] = 0.5
    misfit = pm.Misfit({"s0": dict(dofs=[1], u=data, weight=[4.0])})
    found = coupler.gradient(misfit, steps=STEPS, parameters=CHANGED)
    u = found.history["s0"].u[3, 0]
    assert found.value == pytest.approx(2.0 * (u - 0.5) ** 2, rel=1e-14)
    assert not found.force["s0"][4:].any() and found.force["s0"][3].any()


def test_the_history_of_a_run_that_was_ended_is_kept():
    def stop(done, total):
        raise KeyboardInterrupt

    coupler = problem("macro", (1, 2), (half, fine))
    with pytest.raises(KeyboardInterrupt):
        coupler.run(steps=2, progress=stop)
    last = coupler.last_history
    coupler.gradient(squares, steps=2)
    coupler.jacobian({"s0": [0]}, steps=2, parameters=CHANGED)
    assert last is not None and coupler.last_history is last


def test_differences_of_runs_are_the_gradient_where_both_can_be_had():
    coupler = problem("gc", (1, 2), (half, fine), moved=True)
    pair = pm.Parameters("s1", dofs=[[0, 1], [1, 2], [0, 3]], K=np.eye(2), labels=[1, 0, 1])
    both = [CHANGED, pair]
    coupler.step(2)

    def objective(history):
        return squares(history, True)

    done = []
    exact = coupler.gradient(objective, steps=STEPS, parameters=both)
    found = coupler.gradient(
        objective,
        steps=STEPS,
        parameters=both,
        differences=1e-4,
        progress=lambda *x: done.append(x),
    )
    assert coupler.step_count == 2 and done[-1] == (6, 6)
    assert found.value == exact.value and not found.force and found.velocity is None
    for one, other in zip(found.parameters, exact.parameters):
        assert np.allclose(one, other, rtol=1e-6)


@pytest.mark.parametrize("kind", ["restoring", "internal"])
def test_differences_know_springs(kind):
    """A Duffing oscillator: the slope of u in k against a difference of DOP853 solutions."""
    from scipy.integrate import solve_ivp

    def exact(k):
        def rates(t, y):
            return [y[1], -k * y[0] - 3.0 * y[0] ** 3]

        return solve_ivp(rates, (0.0, 2.0), [1.0, 0.5], "DOP853", rtol=1e-12, atol=1e-12).y[0, -1]

    spring = pm.CubicSpring([0], k=0.0, k3=3.0)
    mass = pm.Subdomain(
        [1.0], [4.0], scheme=pm.Newmark(), u0=[1.0], v0=[0.5], name="mass", **{kind: spring}
    )
    coupler = pm.Coupler([mass], dt=2e-3)
    k = pm.Parameters(mass, dofs=[[0]], K=[[1.0]])
    arguments = dict(parameters=k, what="u", differences=1e-4)
    S = coupler.jacobian({"mass": [0]}, 2.0, **arguments)["mass"]
    slope = (exact(4.0 + 1e-3) - exact(4.0 - 1e-3)) / 2e-3
    assert abs(S[-1, 0, 0] / slope - 1.0) < 1e-4  # (omega dt)^2 with 700 steps in a period
    refused("without differences= needs linear", coupler.gradient, squares, 2.0)
    refused(
        "differences must be", coupler.jacobian, {"mass": [0]}, 2.0, parameters=k, differences=0
    )


def test_differences_know_contacts_and_begin_at_the_start():
    """A mass that strikes a wall twice; steps that were done do not matter from t = 0 on."""

    def bouncing(k):
        mass = pm.Subdomain([1.0], [k], scheme=pm.Newmark(), v0=[1.0])
        walls = [pm.contact(mass, [0], gap=0.1, sign=s, restitution=0.8) for s in (1, -1)]
        return pm.Coupler([mass], walls, dt=0.01)

    def runs(k):
        return bouncing(k).run(0.5)[0].u

    coupler, h = bouncing(4.0), 1e-4
    coupler.step(2)
    data = pm.Misfit({"subdomain 0": dict(dofs=[0], u=np.zeros((51, 1)))})
    arguments = dict(parameters=pm.Parameters("subdomain 0", K=[[[1.0]]]), differences=h)
    slopes = (runs(4.0 + h) - runs(4.0 - h)) / (2.0 * h)
    S = coupler.jacobian({"subdomain 0": [0]}, 0.5, what="u", **arguments)
    assert np.array_equal(S["subdomain 0"][:, :, 0], slopes)
    gradient = coupler.gradient(data, 0.5, **arguments)
    assert np.allclose(gradient.parameters[0], np.sum(runs(4.0) * slopes), rtol=1e-6)
    assert coupler.step_count == 2


def refused(message, call, *arguments, error=ValueError, **named):
    with pytest.raises(error, match=message):
        call(*arguments, **named)


def test_runs_without_such_an_adjoint_are_refused_with_the_reason():
    mass = dict(scheme=half, name="m")
    spring = pm.Subdomain([1.0], [1.0], restoring=pm.CubicSpring([0], 1.0, 1.0), **mass)
    refused("restoring force", pm.Coupler([spring], dt=0.01).gradient, squares, 0.1)
    massless = pm.Subdomain([[1.0, 0.0], [0.0, 0.0]], np.eye(2), **mass)
    refused("mass at each dof", pm.Coupler([massless], dt=0.01).gradient, squares, 0.1)
    refused("trapezoidal", problem("mean", (1, 2), (half, fine)).gradient, squares, 0.1)
    refused("function of u and v", problem("mean", (1, 2), trapezoidal[:2]).gradient, squares, 0.1)
    staggered = problem("gc", (1, 2), (half, fine))
    refused("equal substeps", staggered.jacobian, {"s0": [0]}, 0.1, parameters=CHANGED)


def test_dofs_of_a_misfit_and_of_parameters_have_names_and_count_from_the_end():
    def bar():
        return pm.Subdomain(
            [1.0, 1.0, 1.0],
            np.diag([2.0, 2.0, 1.0]) - np.eye(3, k=1) - np.eye(3, k=-1),
            scheme=pm.Newmark(),
            u0=[0.0, 0.0, 1.0],
            dof_names=["base", "middle", "top"],
            name="bar",
        )

    data = np.random.default_rng(0).normal(size=(11, 2))
    k = [[1.0, -1.0], [-1.0, 1.0]]
    found = []
    for dofs, of in [
        ([0, 2], [[0, 1], [1, 2]]),
        (["base", "top"], [["base", "middle"], ["middle", "top"]]),
        ([0, -1], [[0, 1], [-2, -1]]),
    ]:
        own, misfit = bar(), pm.Misfit({"bar": dict(dofs=dofs, u=data)})
        coupler = pm.Coupler([own], dt=0.1)
        gradient = coupler.gradient(misfit, 1.0, parameters=pm.Parameters(own, dofs=of, K=k))
        found.append((misfit(coupler.run(1.0))[0], *gradient.parameters[0], gradient.value))
        assert repr(misfit) == "<Misfit of 'bar': u of 2 dofs, 11 levels>"
        coupler.reset()
    assert found[0] == found[1] == found[2] and found[0][0] == found[0][-1] > 0.0
    with pytest.raises(ValueError, match="the nearest is 'top'"):
        pm.Parameters(bar(), dofs=[["base", "topp"]], K=k)
    coupler = pm.Coupler([bar()], dt=0.1)
    with pytest.raises(ValueError, match="dofs of 'bar' in the Misfit must be dofs by name"):
        coupler.gradient(pm.Misfit({"bar": dict(dofs=["side"], u=data[:, :1])}), 1.0)
    with pytest.raises(TypeError, match="dofs by name need the Subdomain itself, got its name"):
        pm.Parameters("bar", dofs=[["base", "top"]], K=k)


def test_bad_arguments_are_refused_and_the_coupler_stays_as_it_was():
    coupler = problem("macro", (1, 2), (half, fine))
    coupler.step(2)
    before = coupler.state("s1").u
    call = coupler.gradient
    refused("must have shape", call, lambda h: (0.0, {"s0": {"u": np.zeros((1, 3))}}), steps=3)
    refused("by subdomain", call, lambda h: (0.0, {"x": {}}), steps=3, error=KeyError)
    refused("value and the deriv", call, lambda h: h.peak(), steps=3, error=TypeError)
    refused("u, v or a", call, lambda h: (0.0, {"s0": {"w": 0.0}}), steps=3)
    refused(
        "one of the subdomains",
        call,
        squares,
        steps=3,
        error=KeyError,
        parameters=pm.Parameters("x", dofs=[[0]], K=[[1.0]]),
    )
    outside = pm.Parameters("s1", dofs=[[4]], K=[[1.0]])
    refused("lie in 0..3, got 4", call, squares, steps=3, parameters=outside)
    refused("at least one macro step", call, squares, steps=0)
    far = {"s0": [3]}
    refused(r"sensors\['s0'\]", coupler.jacobian, far, steps=2, parameters=CHANGED)
    refused("must be a Misfit", call, 3.0, steps=3, error=TypeError)
    refused("K, C or M", pm.Parameters, "s1", dofs=[[0]])
    refused("must have shape", pm.Parameters, "s1", dofs=[[0, 1]], K=[[1.0]])
    refused("unknown keys", pm.Misfit, {"s0": dict(dofs=[0], w=np.zeros((4, 1)))})
    assert coupler.step_count == 2 and np.all(coupler.state("s1").u == before)


def cut_wall(stiff=(1.0, 1.0, 1.0), thick=1.0):
    """A wall of three materials, cut into an implicit and an explicit part."""
    material = np.repeat([4, 7, 11], 8)
    E = 100.0 * np.choose(np.repeat([0, 1, 2], 8), stiff)
    t = np.where(material == 7, thick, 1.0)
    wall = pm.structures.plate(6, 4, 0.5, E=E, nu=0.2, rho=1.0, t=t, mass="lumped")
    schemes = [pm.GeneralizedAlpha(0.8), pm.GeneralizedAlpha(0.8, explicit=True)]
    halves = pm.cut(
        wall,
        np.repeat([0, 1], 12),
        scheme=schemes,
        dt=0.05,
        fixed=wall.dofs(wall.nodes_at(y=0.0)),
        force=np.where(np.arange(wall.n) % 2, 0.0, 1.0),
        rayleigh=(0.1, 0.002),
    )
    return halves, halves.coupler(coupling="macro"), material


@pytest.mark.gate
def test_a_cut_gives_factors_of_its_materials_and_thicknesses():
    halves, coupler, material = cut_wall()
    assert halves.subdomains[1].substeps > 1
    of = halves.parameters(material)
    assert [p.labels.tolist() for p in of] == [[4, 7, 11]] * 2
    thickness = halves.parameters(np.where(material == 7, 1, 0), scales="thickness")

    def squares_of_all(history):
        return squares(history)

    found = coupler.gradient(squares_of_all, steps=10, parameters=[*of, *thickness]).parameters
    by_material, by_thickness = found[0] + found[1], (found[2] + found[3])[1]

    def slope(value, e=1e-4):
        near, far = (value(x) - value(-x) for x in (e, 2.0 * e))
        return (8.0 * near - far) / (12.0 * e)

    def changed(**kind):
        return squares(cut_wall(**kind)[1].run(steps=10))[0]

    for j in range(3):
        own = np.eye(3)[j]
        expected = slope(lambda x, own=own: changed(stiff=1.0 + x * own))
        assert abs(by_material[j] / expected - 1.0) < DIFFERENCES
    # the loads do not change with the thickness: they are those of nodes
    expected = slope(lambda x: changed(thick=1.0 + x))
    assert abs(by_thickness / expected - 1.0) < DIFFERENCES
    S = coupler.jacobian({"part 1": [3]}, steps=10, parameters=of, what="u")["part 1"]
    u = [
        cut_wall(stiff=(1.0, 1.0 + x, 1.0))[1].run(steps=10)["part 1"].u[:, 3]
        for x in (-1e-4, 1e-4)
    ]
    both = S[:, 0, 1] + S[:, 0, 4]
    assert np.max(abs((u[1] - u[0]) / 2e-4 - both)) < 1e-6 * np.max(abs(both))


def test_elements_of_a_structure_and_of_groups_are_the_same_factors():
    wall = pm.structures.plate(3, 2, 0.5, E=100.0, nu=0.2, rho=1.0)
    foot = wall.dofs(wall.nodes_at(x=0.0))
    held = pm.reduce(wall.M, wall.K, fixed=foot)
    s = pm.Subdomain(held.M, held.K, scheme=half, name="wall")
    each = pm.element_parameters(wall, s, labels=np.arange(6), fixed=foot)
    total = np.zeros((s.n, s.n))
    for dofs, K in zip(each.dofs, each.matrices["K"]):
        np.add.at(total, np.ix_(dofs, dofs), K)
    assert each.m == 6 and np.allclose(
        total, s.K.toarray(), rtol=0.0, atol=1e-13 * abs(total).max()
    )
    rods = pm.Elements([[-1, 0], [0, 1]], M=[[0.5, 0.5]], K=[[[1.0, -1.0], [-1.0, 1.0]]])
    springs = pm.element_parameters(rods, "chain", labels=["b", "a"])
    assert springs.labels.tolist() == ["a", "b"]
    wrong = dict(fixed=foot, labels=[0, 1])
    refused(r"labels must have shape \(6,\)", pm.element_parameters, wall, s, **wrong)
    wrong |= dict(labels=np.full(6, 0.5), error=TypeError)
    refused("labels must be whole numbers or names", pm.element_parameters, wall, s, **wrong)
    refused("must have the 18 dofs", pm.element_parameters, wall, s)
    refused("scales must be", pm.element_parameters, wall, s, fixed=foot, scales="E")
    refused("come with the dofs", pm.Parameters, "m", K=[np.eye(2)], labels=[0])


def test_combinations_and_multipliers_are_measured_too():
    """The Misfit against the same sum written as a function."""
    coupler = problem("gc", (1, 2), (half, fine))
    W = np.array([[1.0, -1.0, 0.0], [0.0, 2.0, 1.0]])
    rng = np.random.default_rng(4)
    drifts, forces = rng.normal(size=(STEPS + 1, 2)), rng.normal(size=(2 * STEPS + 1, 1))
    above = rng.normal(size=(STEPS + 1, 1))
    drifts[3, 1] = np.nan
    misfit = pm.Misfit(
        {
            "s0": [dict(W=W, u=drifts, v=drifts, weight=[1.0, 3.0]), dict(dofs=[2], u=above)],
            "multipliers": dict(rows=[1], data=forces, weight=0.5),
        }
    )
    assert repr(misfit) == (
        "<Misfit of 's0': u, v of 2 rows, 15 levels; 's0': u of 1 dof, 15 levels; "
        "'multipliers': 1 row, 29 levels>"
    )

    def by_hand(history):
        value, sources = 0.0, {}
        for kind in "uv":
            x = getattr(history["s0"], kind)
            difference = np.nan_to_num(x @ W.T - drifts) * [1.0, 3.0]
            value += 0.5 * np.sum(difference**2 / [1.0, 3.0])
            sources[kind] = difference @ W
        difference = history["s0"].u[:, [2]] - above
        sources["u"][:, [2]] += difference
        lam = np.zeros_like(history.multipliers)
        lam[:, [1]] = 0.5 * (history.multipliers[:, [1]] - forces)
        value += 0.5 * np.sum(difference**2) + np.sum(lam**2)
        return value, {"s0": sources, "multipliers": lam}

    found, expected = (
        coupler.gradient(x, steps=STEPS, parameters=CHANGED) for x in (misfit, by_hand)
    )
    assert found.value == pytest.approx(expected.value, rel=1e-14)
    assert np.allclose(found.parameters[0], expected.parameters[0], rtol=1e-12)
    assert np.allclose(found.u0["s1"], expected.u0["s1"], rtol=1e-10, atol=1e-12)
    for wrong, message, error in (
        ({"s0": dict(W=[[1.0]], u=drifts[:, :1])}, "must have 3 columns", ValueError),
        ({"x": dict(dofs=[0], u=above)}, "Misfit must be of", KeyError),
        ({"multipliers": dict(rows=[2], data=forces)}, "rows of 'multipliers'", ValueError),
    ):
        refused(message, coupler.gradient, pm.Misfit(wrong), steps=STEPS, error=error)
    refused("dofs or W", pm.Misfit, {"s0": dict(u=above)})
    refused("must have data", pm.Misfit, {"multipliers": dict(rows=[0])})


# ---- statements about whole runs -----------------------------------------------------------------


RECIPROCAL = [
    ("gc", (1, 2, 4), three, {}),
    ("gc", (2, 3, 6), (half, explicit, fine), {}),
    ("pm", (1, 4, 2), (half, explicit, fine), {}),
    ("macro", (2, 3, 7), three, {}),
    ("macro", (1, 5, 7), (half, explicit, fine), {"double": True}),
    ("mean", (1, 3, 4), trapezoidal, {}),
]


@pytest.mark.parametrize(("coupling", "substeps", "schemes", "kind"), RECIPROCAL)
def test_a_long_run_and_its_adjoint_have_the_same_products(coupling, substeps, schemes, kind):
    """<W f, y> = <f, W^T y> for loads f from rest and weights y of the motion, 300 macro steps."""
    steps, rng = 300, np.random.default_rng(8)
    coupler = problem(coupling, substeps, schemes, **kind)
    names = [s.name for s in coupler.subdomains]
    loads, weights = {}, {}
    for s in coupler.subdomains:
        shape = (steps * s.substeps + 1, s.n)
        loads[s.name], weights[s.name] = rng.normal(size=shape), rng.normal(size=shape)
        loads[s.name][0] = 0.0
    force = {
        n: pm.SampledForce(loads[n], DT / s.substeps) for n, s in zip(names, coupler.subdomains)
    }
    coupler.reset(force=force)
    what = "v" if coupling == "mean" else "a"

    def product(history):
        value = sum(np.sum(weights[n] * getattr(history[n], what)) for n in names)
        return value, {n: {what: weights[n]} for n in names}

    found = coupler.gradient(product, steps=steps)
    other = sum(np.sum(found.force[n] * loads[n]) for n in names)
    size = sum(np.sum(abs(found.force[n] * loads[n])) for n in names)
    assert abs(found.value - other) < 1e-12 * size


@pytest.mark.parametrize(("coupling", "substeps", "schemes", "kind"), RECIPROCAL)
def test_the_remainder_of_a_step_along_the_gradient_is_of_second_order(
    coupling, substeps, schemes, kind
):
    def objective(history):
        return squares(history, False, "uv" if coupling == "mean" else "uva")

    def value(theta):
        return objective(
            problem(coupling, substeps, schemes, theta=theta, **kind).run(steps=STEPS)
        )[0]

    coupler = problem(coupling, substeps, schemes, **kind)
    found = coupler.gradient(objective, steps=STEPS, parameters=CHANGED)
    remainders = [abs(value(e) - found.value - e * found.parameters[0][0]) for e in (1e-2, 2e-2)]
    assert abs(np.log2(remainders[1] / remainders[0]) - 2.0) < 0.02


@pytest.mark.gate
def test_blocks_of_any_length_have_the_same_gradient():
    """500 macro steps. Rounding grows with the length, most for sources of u, which are integrated
    three times: 2e-10 in one block of 2000."""
    coupler = problem("macro", (1, 5), (half, explicit))
    coupler.reset(force={"s0": np.ones(3), "s1": np.ones(4)})
    found = [
        coupler.gradient(squares, steps=500, parameters=CHANGED, block=block)
        for block in (20, 100, 500)
    ]
    first, *others = (np.append(x.parameters[0], [*x.u0["s0"], *x.v0["s1"]]) for x in found)
    for other in others:
        assert np.max(abs(other - first)) < 1e-10 * np.max(abs(first))


def test_blocks_are_as_long_as_memory_allows(monkeypatch):
    from pmalpha.gradients import gradient

    members = problem("macro", (1, 5), (half, explicit)).subdomains
    level = 8 * sum(s.n * s.substeps for s in members)
    for left, expected in ((None, 100), (10**9, 100), (1000 * level + 240 * level, 10), (1, 1)):
        monkeypatch.setattr(gradient, "available", lambda left=left: left)
        assert gradient.fitting(members, 1000) == expected


def test_with_algorithmic_damping_mean_coupling_is_not_reciprocal(monkeypatch):
    """What is refused would be wrong."""
    from pmalpha.setup.combinations import FEATURES

    def objective(history):
        return squares(history, False, "uv")

    schemes = (pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.8))
    coupler = problem("mean", (1, 5), schemes)
    monkeypatch.setitem(FEATURES, '"mean" and not the trapezoidal rule', lambda x: False)
    wrong = coupler.gradient(objective, steps=STEPS, parameters=CHANGED).parameters[0][0]
    right = coupler.gradient(
        objective, steps=STEPS, parameters=CHANGED, differences=1e-4
    ).parameters[0][0]
    assert abs(wrong / right - 1.0) > 1e-4
