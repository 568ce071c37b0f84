"""What a type checker says of a user's script, and where the package is found."""

import importlib.util
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import waits

import pmalpha as pm

pytestmark = pytest.mark.gate

ROOT = Path(__file__).parent.parent

RIGHT = """
import numpy as np
import scipy.sparse as sp

import pmalpha as pm

n = 3
K = np.eye(n)
a = pm.Subdomain([1.0, 2.0, 3.0], K, C=0.1 * K, scheme=pm.GeneralizedAlpha(0.8), name="a")
b = pm.Subdomain(
    np.ones(n),
    [[2, -1, 0], [-1, 2, -1], [0, -1, 2]],
    scheme=pm.CentralDifference(),
    substeps=4,
    damping="lagged",
    u0=[0, 0, 0],
    force=lambda t: np.array([0.0, 0.0, t]),
)
c = pm.Subdomain(1.0, 4.0, scheme=pm.HHT(0.1), force=pm.SampledForce([0.0, 1.0], dt=0.1))
d = pm.Subdomain(sp.eye_array(3), sp.csr_matrix(K), scheme=pm.Newmark(), restoring=None)
ties = [pm.tie(a, [0, 1], b, np.array([0, 1])), pm.tie(b, 2, c, 0)]
drive = pm.Constraint({a: [[0.0, 0.0, 1.0]]}, velocity=lambda t: [np.sin(t)])
both, named = {a: np.eye(3), b: -np.eye(3)}, {"a": np.eye(3), "b": -np.eye(3)}
glued = [pm.Constraint(both), pm.Constraint(named)]
coupler = pm.Coupler([a, b, c], [*ties, drive], dt=0.1, coupling="gc", start="plain", threads=2)
history = coupler.run(1.0, record={"a": [0], b: None}, every=2)
reveal_type(history)  # History
reveal_type(history["a"])  # SubdomainHistory
reveal_type(coupler.state(a))  # State
peak: float = np.abs(history["a"].u).max()
name: str = coupler.run(steps=1)[0].name
pm.reduce(np.ones(n), K, fixed=[True, False, False])
isolators = pm.BoucWen([0, 1], k=50.0, fy=[1.0, 2.0])
quake = pm.BaseAcceleration([0.0, 1.0], dt=0.01, direction=np.ones(3), M=a.M)
e = pm.Subdomain(
    a.M, a.K, scheme=a.scheme, restoring=[isolators, lambda t, u, v: 0.1 * u**3], force=quake
)
run = pm.Coupler([e], dt=0.01)
balance: float = np.abs(run.run(0.1, energy=True).energy.balance).max()
order: float = pm.analysis.observed_order(lambda dt: dt**2, np.array([0.1, 0.2]))
plate = pm.structures.plate(4, 2, 0.1, E=1.0, nu=0.3, rho=1.0)
wall = plate.subdomain(scheme=pm.Newmark(), name="wall")
edge = plate.nodes_at(x=0.0)
walled = pm.Coupler([wall], pm.Constraint({wall: np.eye(wall.n)[plate.dofs(edge)]}), dt=0.01)
"""

WRONG = """
import numpy as np

import pmalpha as pm

a = pm.Subdomain([1.0], [1.0], scheme=pm.Newmark())
pm.Subdomain("M", [1.0], scheme=pm.Newmark())  # arg-type
pm.Subdomain([1.0], ["k"], scheme=pm.Newmark())  # arg-type
pm.Subdomain([1.0], [1.0], scheme="newmark")  # arg-type
pm.Subdomain([1.0], [1.0], scheme=pm.Newmark(), damping="lag")  # arg-type
pm.Coupler([a], dt=0.1, coupling="GC")  # arg-type
pm.Coupler([a], dt=0.1, start="rebase")  # arg-type
pm.Coupler([a], dt=0.1, step=3)  # call-arg
pm.tie(a, 0.5, a, 0)  # arg-type
pm.Coupler([a], dt=0.1).run(1.0)["a"].w  # attr-defined
"""


# What pyright calls the mistakes that mypy reports with the codes of WRONG.
PYRIGHT = {
    "arg-type": "reportArgumentType",
    "call-arg": "reportCallIssue",
    "attr-defined": "reportAttributeAccessIssue",
}


@pytest.fixture(scope="module")
def user(tmp_path_factory):
    """A folder of a user with the two scripts."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "right.py").write_text(RIGHT)
    (folder / "wrong.py").write_text(WRONG)
    return folder


@pytest.fixture(scope="module")
def reports(user):
    """Lines that mypy prints on the two scripts."""
    pytest.importorskip("mypy")
    # as strict as for the package in `make analyze`, which finds the stubs of NumPy as read here
    command = [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml"]
    command += ["--cache-dir", ROOT / "build" / "mypy", "right.py", "wrong.py"]
    run = subprocess.run(command, cwd=user, capture_output=True, text=True, timeout=waits.LIMIT)
    assert not run.stderr
    lines = run.stdout.splitlines()
    return {name: [x for x in lines if x.startswith(name)] for name in ("right", "wrong")}


@pytest.fixture(scope="module")
def of_pyright(user):
    """What pyright reports on the two scripts: dicts with file, severity, rule and range."""
    pytest.importorskip("pyright")
    command = [sys.executable, "-m", "pyright", "--outputjson"]
    command += ["--pythonpath", sys.executable, "right.py", "wrong.py"]
    run = subprocess.run(command, cwd=user, capture_output=True, text=True, timeout=waits.LIMIT)
    return json.loads(run.stdout)["generalDiagnostics"]


def mistakes():
    """Line and mypy's code of each mistake in WRONG."""
    lines = enumerate(WRONG.splitlines(), 1)
    return {number: line.split("# ")[1] for number, line in lines if "# " in line}


def test_a_script_that_runs_has_no_errors_and_the_results_have_their_types(reports):
    assert not [line for line in reports["right"] if ": error:" in line]
    revealed = [re.search(r'Revealed type is "(.*)"', line)[1] for line in reports["right"]]
    wanted = re.findall(r"reveal_type.*# (\w+)", RIGHT)
    assert [name.split(".")[-1] for name in revealed] == wanted


def test_pyright_accepts_the_script_that_runs_and_finds_the_types_of_its_results(of_pyright):
    found = [x for x in of_pyright if Path(x["file"]).name == "right.py"]
    assert not [x["message"] for x in found if x["severity"] != "information"]
    revealed = [re.search(r'is "(\w+)"$', x["message"])[1] for x in found]
    assert revealed == re.findall(r"reveal_type.*# (\w+)", RIGHT)


def test_pyright_names_every_mistake_of_a_script_with_its_line(of_pyright):
    found = {
        x["range"]["start"]["line"] + 1: x["rule"]
        for x in of_pyright
        if Path(x["file"]).name == "wrong.py"
    }
    assert found == {number: PYRIGHT[code] for number, code in mistakes().items()}


def test_the_script_that_both_checkers_accept_runs(monkeypatch):
    monkeypatch.setattr("builtins.reveal_type", lambda x: x, raising=False)
    exec(compile(RIGHT, "right.py", "exec"), {})


def test_every_mistake_of_a_script_is_named_with_its_line(reports):
    found = {
        int(match[1]): match[2]
        for line in reports["wrong"]
        if (match := re.match(r"wrong\.py:(\d+): error: .*\[([\w-]+)\]$", line))
    }
    assert found == mistakes()


def test_a_folder_of_the_same_name_does_not_shadow_the_package(tmp_path):
    # as in the parent folder of a clone; a namespace package there has no __file__
    (tmp_path / "pmalpha").mkdir()
    command = [sys.executable, "-c", "import pmalpha; print(pmalpha.__file__, pmalpha.Coupler)"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=waits.LIMIT)
    assert run.returncode == 0, run.stderr
    assert Path(run.stdout.split()[0]).samefile(pm.__file__)


def test_the_package_has_the_marker_of_typed_packages():
    assert (Path(importlib.util.find_spec("pmalpha").origin).parent / "py.typed").exists()


def test_editors_show_what_functions_a_subdomain_takes():
    given = inspect.signature(pm.Subdomain).parameters
    shown = {name: str(given[name].annotation) for name in ("force", "restoring", "internal")}
    assert "Load" in shown["force"] and "MotionLoad" in shown["force"]
    assert "RestoringForce" in shown["restoring"]
    assert "InternalForceFunction" in shown["internal"]
