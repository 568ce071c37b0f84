"""The program of docs/other-programs.md, against what OpenSees computes alone."""

import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import waits

import pmalpha as pm
from pmalpha.rig.calls import Client, RemoteError, started

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "examples"))

import opensees_model as example  # noqa: E402
import rig  # noqa: E402

pytestmark = pytest.mark.gate

pytest.importorskip("openseespy", reason="OpenSeesPy is not installed")
imported = subprocess.run(
    [sys.executable, "-c", "import opensees_model; opensees_model.opensees()"],
    cwd=ROOT / "examples",
    capture_output=True,
    text=True,
    timeout=110,  # s, which only ends an import that hangs
)
if imported.returncode:
    pytest.skip(f"OpenSeesPy cannot be imported: {imported.stderr}", allow_module_level=True)

NEWTON, LINEAR = 1, 0


@contextmanager
def alone(what, *numbers):
    """A function of tests/opensees_own.py."""
    program = [ROOT / "tests" / "opensees_own.py", what, *numbers]
    with (
        started(program, timeout=waits.LIMIT) as (address, _),
        Client(address, timeout=waits.LIMIT) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def page():
    """The names of the program of the page, which was run; it prints what is shown."""
    text = (ROOT / "docs" / "other-programs.md").read_text()
    section = re.search(r"\n## OpenSees\n(.*?)\n## ", text, re.S)[1]
    code = "".join(re.findall(r"```python\n(.*?)```", section, re.S))
    names, printed = {}, []
    names["print"] = lambda value: printed.append(str(value))
    exec(compile(code, "other-programs.md", "exec"), names)
    assert printed == re.findall(r"print\(.*\)  # (.*)", code)
    return names


@pytest.fixture(scope="module")
def transient():
    with alone("transient") as client:
        yield client


def rows_in_the_whole():
    """Rows of the lower part and of the upper one in the whole frame, by nodes in order."""
    nodes = [3, 4, 5, 6, 7, 8, 11, 12]

    def rows(chosen):
        return [3 * nodes.index(node) + k for node in chosen for k in range(3)]

    return rows([3, 4, 11, 12]), rows([3, 4, 5, 6, 7, 8])


# ---- matrices -----------------------------------------------------------------------------------


def test_the_matrices_of_the_parts_add_up_to_those_of_the_whole(page):
    matrices = page["matrices"]
    for k, whole in enumerate(matrices["whole"]):
        total = np.zeros_like(whole)
        for part, rows in zip(("lower", "upper"), rows_in_the_whole()):
            total[np.ix_(rows, rows)] += matrices[part][k]
        # sums of a few numbers in another order
        np.testing.assert_allclose(total, whole, rtol=0.0, atol=1e-15 * abs(whole).max())


def test_damping_is_proportional_and_eigenvalues_are_those_of_opensees(page):
    M, C, K = page["matrices"]["whole"]
    mass, stiffness = example.DAMPING
    np.testing.assert_allclose(C, mass * M + stiffness * K, rtol=0.0, atol=1e-15 * abs(C).max())
    with alone("eigenvalues") as eigenvalues:
        expected = eigenvalues()
    # two solvers of a problem with eigenvalues up to 1e7: rounding times that over the lowest, 36
    found = scipy.linalg.eigh(K, M, eigvals_only=True)[:6]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


# ---- linear, against the transient analysis of OpenSees ------------------------------------------

DAMPED = pm.GeneralizedAlpha(0.8)


@pytest.mark.parametrize(
    "integrator, numbers, scheme",
    [
        (0, [0.5, 0.25], pm.Newmark()),
        (1, [0.8], pm.HHT(0.2)),
        (2, [1.0 - DAMPED.am, 1.0 - DAMPED.af], DAMPED),
    ],
    ids=["Newmark", "HHT", "GeneralizedAlpha"],
)
def test_whole_and_cut_frame_move_as_in_opensees(page, transient, integrator, numbers, scheme):
    expected = transient(integrator, numbers, LINEAR, 0.05, 0.02, 100)
    whole = pm.solve(page["linear"]("whole", scheme, 0.05), 0.02, 2.0)
    history = page["cut"](scheme)
    lower, upper = rows_in_the_whole()
    # measured 2e-15 to 5e-15: a rounding of 1e-16 times the condition 1e2 of the matrix of a step
    tolerance = 1e-13 * abs(expected).max()
    for u, rows in (
        (whole.u, slice(None)),
        (history["lower"].u, lower),
        (history["upper"].u, upper),
    ):
        np.testing.assert_allclose(u, expected[:, rows], rtol=0.0, atol=tolerance)
    other = transient(0, [0.5, 0.2], LINEAR, 0.05, 0.02, 100)  # another beta is seen
    assert abs(other - expected).max() > 1e-4 * abs(expected).max()


# ---- nonlinear ----------------------------------------------------------------------------------


def test_the_iterated_cut_frame_yields_as_the_whole_one_in_opensees(page, transient):
    u = transient(0, [0.5, 0.25], NEWTON, 3.0, 0.02, 100)
    elastic = 3e3 * transient(0, [0.5, 0.25], NEWTON, 1e-3, 0.02, 100)
    assert abs(u - elastic).max() > 0.05 * abs(u).max()
    assert abs(u[:91] - elastic[:91]).max() > 0.005 * abs(u).max()  # before the snapshot already
    rows = rows_in_the_whole()
    for history, expected in ((page["iterated"], u[:91]), (page["rest"], u[90:])):
        for part, chosen in zip(("lower", "upper"), rows):
            # both iterate to a tolerance near rounding; measured 1e-14
            np.testing.assert_allclose(
                history[part].u, expected[:, chosen], rtol=0.0, atol=1e-12 * abs(u).max()
            )
    assert page["iterated"]["lower"].iterations.sum() > 80  # Newton's method had something to do


def test_a_trial_changes_no_state_and_the_tangent_is_the_derivative():
    with example.served("lower", "states") as model:
        force, zero = example.internal(model), np.zeros(12)
        u = np.zeros(12)
        u[[0, 3]], u[[2, 5]], u[[6, 9]] = 0.05, 0.002, 0.02
        f, K, state = model(0.0, u, zero, [0.0])
        start = model(0.0, zero, zero, [0.0])
        assert abs(start[1] - K).max() > 0.5 * abs(K[0, 0])  # it has yielded ...
        assert not start[0].any()  # ... in a copy
        unloaded = model(0.0, zero, zero, state)[0]
        assert abs(unloaded).max() > 0.1 * abs(f).max()  # from the state it returns the other way
        # the number of a state is its path, and each path gives the same again
        again = model(0.0, u, zero, [0.0])
        for one, other in zip(again, (f, K, state), strict=True):
            np.testing.assert_array_equal(one, other)
        assert force.check(u, q=[0.0]).error < 1e-7


def test_passes_of_macro_coupling_go_back_to_earlier_states(page):
    """With equal steps macro coupling has the equations of gc, but repeats the steps."""

    def run(coupling, internal=None):
        parts = []
        for part in ("lower", "upper"):
            M, C, K = page["matrices"][part]
            load = 40.0 * M.diagonal() * np.tile([1, 0, 0], len(M) // 3)  # yields in three steps
            how = {"scheme": pm.Newmark(), "force": load, "name": part}
            if part == "lower" and internal is not None:
                K, how["internal"] = None, internal
            parts.append(pm.Subdomain(M, K, C=C, **how))
        return pm.Coupler(parts, page["ties"], dt=0.02, coupling=coupling).run(steps=6)["lower"].u

    with example.served("lower", "states") as model:
        internal = example.internal(model)
        gc, once = run("gc", internal), model.number
        macro = run("macro", internal)
        assert model.number - once > 2 * once
    assert abs(gc - run("gc")).max() > 0.1 * abs(gc).max()
    # both iterate to the default tolerance, 1e-8
    np.testing.assert_allclose(macro, gc, rtol=0.0, atol=1e-6 * abs(gc).max())


def test_what_opensees_cannot_solve_is_an_error_here_and_the_next_trial_is_served():
    with example.served("lower", "states") as model:
        u, zero = np.full(12, np.nan), np.zeros(12)
        with pytest.raises(RemoteError, match="OpenSees found no equilibrium at"):
            model(0.0, u, zero, [0.0])
        with pytest.raises(RemoteError, match="state 7 is none of this process"):
            model(0.0, zero, zero, [7.0])
        assert not model(0.0, zero, zero, [0.0])[0].any()


def test_a_spring_of_opensees_is_the_spring_of_the_core():
    spring = rig.specimen["k"], rig.specimen["fy"], rig.specimen["hardening"]
    with alone("spring", *spring) as specimen:
        by_opensees = rig.hybrid(specimen).run(steps=200)
        assert specimen.number == 1 + 200 * rig.substeps
    by_core = rig.hybrid(pm.Bilinear([0], **rig.specimen)).run(steps=200)
    largest = abs(by_core["rig"].u).max()
    assert largest > 2.0 * rig.specimen["fy"] / rig.specimen["k"]  # it yields
    # the same law in another order of operations, as in test_examples.py
    np.testing.assert_allclose(by_opensees["rig"].u, by_core["rig"].u, atol=1e-12 * largest)


def test_the_tested_storey_yields_as_the_iterated_one(page, transient):
    """Another method: explicit, substeps, no inner masses; equal to the errors of the steps."""
    u = transient(0, [0.5, 0.25], NEWTON, 3.0, 0.005, 400)
    drift, tested = u[::2, 0], page["tested"]["upper"].u[:, 0]
    assert abs(tested - drift).max() < 0.03 * abs(drift).max()
    elastic = transient(0, [0.5, 0.25], NEWTON, 1e-3, 0.005, 400)[::2, 0] * 3e3
    assert abs(tested - elastic).max() > 0.05 * abs(drift).max()
