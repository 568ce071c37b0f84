"""All that is public is in the problems (problems.py) or in the relations between their runs.

An argument or a class that is new fails here until a feature or a relation uses it.
"""

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest
from problems import FEATURES, Problem, draw, shrunk

import pmalpha as pm
from pmalpha import rig

# What no problem has, and where it is tried instead.
ELSEWHERE = {
    "Cut Elements cut element_parameters": "test_cut.py: structures in pieces",
    "c_library": "every frozen model",
    "solve": "a Coupler of one subdomain",
    "History SubdomainHistory": "made by runs",
    "rig.Client rig.Command rig.Connected rig.connect rig.serve": "test_rig_wire.py",
    "rig.serve_calls rig.started": "test_remote.py",
    "rig.Evaluation rig.evaluate rig.Monitored rig.read_monitor rig.Response rig.RigRecord"
    " rig.Tracking rig.tracking": "what is made of a test, test_rig_model.py",
    "Coupler.comm": "processes, rank_bitwise.py",
    "Coupler.export_fmu.inputs Coupler.export_fmu.license Coupler.export_fmu.units": "test_fmu.py",
    "Coupler.jacobian": "test_gradients.py",
    "Coupler.monitor": "test_remote.py",
    "Coupler.run.t_end Coupler.step.n Coupler.estimate_error.t_end Coupler.gradient.t_end"
    " Coupler.run_each.t_end Study.t_end": "steps= is the same",
    "Study.run.map Study.run.save_to": "test_study.py",
    "Coupler.run_paced.priority Coupler.run_paced.lock_memory": "rights, test_paced.py",
    "Coupler.gradient.block Study.together Parameters.labels Coupler.static.steps": "parts of work",
    "Coupler.run_each.record_to Coupler.run_paced.record_to": "test_record_to.py",
    "Coupler.freeze.inputs": "test_frozen_models.py",
    "History.plot History.plot_energy History.to_pyvista History.contact_fields"
    " SubdomainHistory.plot SubdomainHistory.to_pyvista": "pictures",
    "History.resampled History.at SubdomainHistory.at": "SubdomainHistory.resampled is the same",
    "SubdomainHistory.save": "History.save",
    "contact_coincident.normal": "by position",
}
# Arguments of all that runs or reads; and those that are there twice, by another name.
EVERYWHERE = {
    "progress",
    "overwrite",
    "append",
    "self",
    "path",
    "reduced",
    "as_run",
    "options",
    "changes",
}


def excepted():
    return {name for names in ELSEWHERE for name in names.split()}


def public():
    """All names with the arguments of each: classes, functions and methods."""
    found = {}
    for prefix, module in (("", pm), ("rig.", rig)):
        for name in module.__all__:
            value = getattr(module, name)
            if not callable(value) or name.endswith(("Error", "Warning")):
                continue
            found[prefix + name] = arguments_of(value)
    for owner in (pm.Coupler, pm.History, pm.SubdomainHistory, pm.Study, pm.Subdomain):
        for name, value in vars(owner).items():
            if inspect.isfunction(value) and not name.startswith("_") and value.__doc__:
                found[f"{owner.__name__}.{name}"] = arguments_of(value)
    return found


def arguments_of(value):
    return [n for n in inspect.signature(value).parameters if n not in EVERYWHERE]


def calls(text):
    """The last name of what a program calls, with the names and the number of its arguments."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, (ast.Attribute, ast.Name)):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            named = {k.arg for k in node.keywords if k.arg}
            yield name, len(node.args), named
        if isinstance(node, ast.Call):  # dict(name=...) and {"name": ...} are handed on
            yield "dict", 0, {k.arg for k in node.keywords if k.arg}
        if isinstance(node, ast.Dict):
            yield "dict", 0, {k.value for k in node.keys if isinstance(k, ast.Constant)}


@pytest.fixture(scope="module")
def used():
    """Names that are called, and arguments of any call by name or position."""
    names = "relations.py", "known_relations.py"
    texts = [Path(__file__).with_name(name).read_text() for name in names]
    for name in FEATURES:
        for seed in range(8):
            problem = draw(np.random.default_rng([seed, 7]), wanted=[name], size=2)
            texts.append(problem.program)
    names, given = set(), {}
    for text in texts:
        for name, count, named in calls(text):
            names.add(name)
            most, before = given.get(name, (0, set()))
            given[name] = max(most, count), before | named
    return names, given


@pytest.mark.parametrize("name", [n for n in public() if n not in excepted()])
def test_a_drawing_or_a_relation_uses_it_and_each_of_its_arguments(name, used):
    names, given = used
    last = name.split(".")[-1]
    assert last in names, f"no feature of problems.py and no relation uses {name}"
    count, named = given[last]
    named = named | given["dict"][1]
    arguments = public()[name]
    left = [x for x in arguments[count:] if x not in named and f"{name}.{x}" not in excepted()]
    assert left == [], f"nothing uses {left} of {name}"


def test_the_exceptions_are_names_that_exist():
    known = public()
    for name in excepted():
        owner, _, last = name.rpartition(".")
        assert name in known or last in known.get(owner, []), name


@pytest.mark.parametrize("name", FEATURES)
def test_a_problem_with_one_feature_is_a_program_below_thirty_lines(name):
    problem = draw(np.random.default_rng(3), wanted=[name], size=1)
    assert name in problem.features()
    assert len(problem.program.splitlines()) < 30
    compile(problem.program, name, "exec")


def test_a_problem_that_fails_is_shrunk_to_what_makes_it_fail():
    problem = draw(np.random.default_rng(5), wanted=["gap springs", "lagged damping"], size=8)
    assert len(problem.choices) > 4 and problem.count > 1

    def fails(p):
        return {"gap springs", "lagged damping"} <= p.features()

    small = shrunk(problem, fails)
    assert small.features() == {"gap springs", "lagged damping"} and small.count <= problem.count
    assert "pm.Gap" in small.program and "lagged" in small.program


def test_a_problem_is_the_same_when_it_is_made_again_and_another_by_another_seed():
    one, two = (Problem(5, 2, (("cubic springs", 1),)).program for _ in range(2))
    assert one == two
    assert one != Problem(6, 2, (("cubic springs", 1),)).program
