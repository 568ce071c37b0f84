"""Gradients where loads depend on masses, without stiffness, and where steps have changed.

Against central differences of fourth order of whole runs, whose truncation is below 1e-9.
"""

import numpy as np
import pytest
from agreement import assert_close

import pmalpha as pm
from pmalpha import structures

STEPS, DT = 12, 0.1
half, explicit = pm.GeneralizedAlpha(0.5), pm.GeneralizedAlpha(0.8, explicit=True)
CASES = [
    ("gc", (1, 3), (half, explicit), False),
    ("pm", (1, 2), (half, half), True),
    ("macro", (2, 3), (half, explicit), True),
    ("mean", (1, 2), (pm.Newmark(), pm.Newmark()), False),
]
SLOPE = 1e-8
ALONG = np.array([0.7, -0.4, 0.5])


def heavier(seed=1):
    """dM of three parameters, of full matrices."""
    rng = np.random.default_rng(seed)
    return [0.1 * B @ B.T for B in rng.normal(size=(3, 3, 3))]


def shaken(coupling, substeps, schemes, average, theta=(0.0, 0.0, 0.0), stiff=True):
    """Two subdomains under a ground motion that begins with a jump; the first one has theta."""
    rng = np.random.default_rng(3)
    subdomains = []
    for i, (s, scheme) in enumerate(zip(substeps, schemes)):
        M, B = rng.uniform(1.0, 2.0, 3), rng.normal(size=(3, 3))
        record, direction = rng.normal(size=40), rng.normal(size=3)
        if i == 0:
            M = np.diag(M) + sum(x * dM for x, dM in zip(theta, heavier()))
        quake = pm.BaseAcceleration(record, direction, M, dt=0.7 * DT / s, average=average)
        K = 4.0 * B @ B.T if stiff or i else np.zeros((3, 3))
        subdomains.append(pm.Subdomain(M, K, scheme=scheme, substeps=s, force=quake, name=f"s{i}"))
    return pm.Coupler(subdomains, pm.tie("s0", [0], "s1", [2]), dt=DT, coupling=coupling)


def objective(history):
    """Weighted squares of u of both subdomains."""
    rng, value, sources = np.random.default_rng(5), 0.0, {}
    for name, _ in history.keys:
        u = history[name].u
        weight = rng.uniform(1.0, 2.0, u.shape)
        value += 0.5 * np.sum(weight * u**2)
        sources[name] = {"u": weight * u}
    return value, sources


def slope(value, e=1e-3):
    """Of a function of the parameters along ALONG."""
    near, far = (value(x * ALONG) - value(-x * ALONG) for x in (e, 2.0 * e))
    return (8.0 * near - far) / (12.0 * e)


@pytest.mark.filterwarnings("ignore::pmalpha.AccuracyWarning")
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("stiff", [True, False])
def test_a_mass_in_a_ground_motion_is_a_mass_in_the_load_too(case, stiff):
    masses = pm.Parameters("s0", M=heavier())
    expected = slope(lambda x: objective(shaken(*case, theta=x, stiff=stiff).run(steps=STEPS))[0])
    coupler = shaken(*case, stiff=stiff)
    for how in ({}, {"block": 5}, {"differences": 1e-4})[: 3 if stiff else 1]:
        found = coupler.gradient(objective, steps=STEPS, parameters=masses, **how).parameters[0]
        within = 1e-6 if "differences" in how else SLOPE  # those are of order two
        assert_close(found @ ALONG, expected, within, f"gradient {how}", size=abs(expected))


@pytest.mark.filterwarnings("ignore::pmalpha.AccuracyWarning")
@pytest.mark.parametrize("case", CASES[2:])
def test_a_jacobian_knows_that_the_load_has_the_mass(case):
    masses, sensors = pm.Parameters("s0", M=heavier()), {"s0": [1], "s1": [0]}
    found = shaken(*case).jacobian(sensors, steps=STEPS, parameters=masses, what="u")

    def motion(x):
        run = shaken(*case, theta=x).run(steps=STEPS)
        return np.concatenate([run[name].u[:, dofs].ravel() for name, dofs in sensors.items()])

    expected = slope(motion)
    got = np.concatenate([(found[name] @ ALONG).ravel() for name in sensors])
    assert_close(got, expected, SLOPE, "jacobian", size=np.abs(expected).max())


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_density_of_a_cut_structure(mass):
    """A factor of the mass of the right half, whose elements two subdomains have."""
    labels, halves = np.tile([0, 1], 4), np.tile(["a", "a", "b", "b"], 2)

    def cut(x):
        rho = np.where(halves == "b", 2.0 + 2.0 * x, 2.0)
        wall = structures.plate(4, 2, 0.5, E=4.0, nu=0.2, rho=rho, mass=mass)
        foot = wall.dofs(wall.nodes_at(y=0.0))
        direction = np.tile([1.0, 0.0], wall.n // 2)
        direction[foot] = 0.0
        record = np.random.default_rng(7).normal(size=20)
        quake = pm.BaseAcceleration(record, direction, wall.M, dt=DT)
        return pm.cut(wall, labels, fixed=foot, force=quake, scheme=half)

    def value(x):
        return objective(cut(x).coupler(DT, coupling="macro").run(steps=STEPS))[0]

    e = 1e-3
    expected = (8.0 * (value(e) - value(-e)) - value(2.0 * e) + value(-2.0 * e)) / (12.0 * e)
    own = cut(0.0)
    parameters = own.parameters(halves, scales="mass")
    found = own.coupler(DT, coupling="macro").gradient(
        objective, steps=STEPS, parameters=parameters
    )
    total = sum(x[1] for x in found.parameters)
    assert_close(total, expected, SLOPE, "gradient", size=abs(expected))


def test_a_ground_motion_of_another_mass_is_refused():
    # that of a bar with consistent masses, whose support pulls at its neighbour
    bar = structures.rod(2, 2.0, EA=1.0, rhoA=1.0)
    quake = pm.BaseAcceleration([1.0, 2.0], dt=DT)
    s = bar.subdomain(scheme=half, fixed=0, force=quake, name="s")
    masses = pm.Parameters(s, M=[np.eye(2)])
    with pytest.raises(ValueError, match="made of the M of the same subdomain, got another one on"):
        pm.Coupler([s], dt=DT).gradient(objective, steps=3, parameters=masses)


@pytest.mark.parametrize("how", [{}, {"differences": 1e-4}])
def test_sources_on_multipliers_without_stiffness(how):
    def squares(history):
        lam = history.multipliers
        return 0.5 * np.sum(lam**2), {"multipliers": lam}

    case = ("gc", (1, 2), (half, half), False)
    masses = pm.Parameters("s0", M=heavier())
    expected = slope(lambda x: squares(shaken(*case, theta=x, stiff=False).run(steps=STEPS))[0])
    coupler = shaken(*case, stiff=False)
    found = coupler.gradient(squares, steps=STEPS, parameters=masses, **how).parameters[0]
    within = 1e-6 if how else SLOPE
    assert_close(found @ ALONG, expected, within, "gradient", size=abs(expected))


def test_changed_steps_are_refused():
    coupler = shaken(*CASES[0])
    coupler.step(2)
    coupler.change_steps(0.05)
    masses = pm.Parameters("s0", M=heavier())
    for call in (
        lambda: coupler.gradient(objective, steps=3, parameters=masses),
        lambda: coupler.jacobian({"s0": [0]}, steps=3, parameters=masses, differences=1e-4),
    ):
        with pytest.raises(ValueError, match=r"dt = 0\.1, got those of change_steps"):
            call()
    coupler.change_steps(DT)
    assert coupler.gradient(objective, steps=3).history.macro_times[-1] == pytest.approx(3.0 * DT)
