"""No mode grows while contact lasts: macro steps of unit states about a pressed one."""

import numpy as np
import pytest
from contact_problems import SCHEMES
from pairwise import in_turn

import pmalpha as pm
from pmalpha.analysis.amplification import layout_of
from pmalpha.setup.stability import critical_product

# Force that presses the contact, for steps of length 1, masses near 1 and unit states.
PRESS = 1e3
N = 3


def chain(rng, scheme, step, **options):
    """Masses and springs to the ground and between them: explicit near the limit, implicit ones
    with any highest frequency."""
    M, k = rng.uniform(0.5, 2.0, N), rng.uniform(0.5, 2.0, N)
    K = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    top = np.sqrt(np.linalg.eigvalsh(K / np.sqrt(np.outer(M, M)))[-1])
    if scheme.explicit:
        product = rng.uniform(0.5, 0.97) * critical_product(scheme)
    else:
        product = 10.0 ** rng.uniform(-0.5, 1.0)
    return pm.Subdomain(M, K * (product / (step * top)) ** 2, scheme=scheme, **options)


def problem(seed, schemes, substeps, coupling, between):
    """A tied to B with substeps; B on an obstacle, or pressed against C, which is as fine."""
    rng = np.random.default_rng(seed)
    first, second = (SCHEMES[name] for name in schemes)
    fine = {"substeps": substeps, "double_step": False}
    load = np.array([0.0, 0.0, -PRESS])
    a = chain(rng, first, substeps, name="A")
    b = chain(rng, second, 1.0, force=load, name="B", **fine)
    # the obstacle is above whatever displacement, so that the gap stays closed
    motion = (lambda t: np.full(1, 100.0 if t > 0.0 else 0.0)), (lambda t: np.zeros(1))
    parts = [a, b]
    if between:
        parts.append(chain(rng, first, 1.0, force=-load, name="C", **fine))
        rows = pm.contact(parts[2], [2], b, [2], motion=motion)
    else:
        rows = pm.contact(b, [2], motion=motion)
    constraints = [pm.tie(a, [2], b, [0]), rows]
    return pm.Coupler(parts, constraints, dt=float(substeps), coupling=coupling, threads=1)


def closed_steps(coupler):
    """Amplification of a macro step with closed rows, by unit states to both sides; the velocity
    of the row after them."""
    coupler.step(1)
    snapshot, layout, core = coupler.snapshot(), layout_of(coupler), coupler._session.core
    cores, names = [part.core for part in layout.members], layout.names()
    sides = {"v[2] of B at n": 1.0, "v[2] of C at n": -1.0}
    row = np.array([sides.get(name, 0.0) for name in names])

    def after(x):
        coupler.restore(snapshot)
        contact = {"contact": core.numbers()["contact"]}
        layout.write(core, cores, x[:, None])
        core.set_numbers(core.numbers() | contact)
        coupler.step(1)
        return layout.read(core, cores, 1)[:, 0]

    # approaching in every state: (U5) with e = 0 then demands y = 0
    base = np.where(row > 0.0, -3.0, 0.0)
    end, units = after(base), np.eye(layout.size)
    forth = np.array([after(base + e) - end for e in units]).T
    back = np.array([end - after(base - e) for e in units]).T
    return forth, back, row @ end


PAIRS = [
    ("TR", "CD"),
    ("CD", "TR"),
    ("TR", "TR"),
    ("rho 0.5", "CD"),
    ("rho 0.8", "explicit 0.5"),
    ("rho 0", "rho 0.8"),
]


def require_that_no_mode_grows(seeds, schemes, coupling, substeps):
    for seed in seeds:
        for between in (False, True):
            coupler = problem(seed, schemes, substeps, coupling, between)
            forth, back, y = closed_steps(coupler)
            # or a row has opened: then steps are not linear, and it has a velocity
            assert abs(y) < 1e-10
            np.testing.assert_allclose(forth, back, atol=1e-11 * np.abs(forth).max())
            assert np.abs(np.linalg.eigvals(forth)).max() < 1.0 + 1e-9


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize(
    ("schemes", "schedule"),
    [*in_turn(PAIRS, ("gc", 1), ("gc", 5), ("pm", 5)), *in_turn(PAIRS[:3], ("gc", 5), ("pm", 5))],
)
def test_no_mode_grows_while_contact_lasts(schemes, schedule):
    require_that_no_mode_grows([0], schemes, *schedule)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")
@pytest.mark.parametrize("coupling", ["gc", "pm"])
@pytest.mark.parametrize("substeps", [1, 2, 5, 20])
@pytest.mark.parametrize("schemes", PAIRS)
def test_no_mode_of_48_problems_each_grows(schemes, substeps, coupling):
    require_that_no_mode_grows(range(1, 25), schemes, coupling, substeps)
