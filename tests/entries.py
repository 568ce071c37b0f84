"""The public functions with good arguments, for campaign_input.py to spoil.

An entry is a function of a random generator that returns a function, its keyword arguments, and
what is done with the result: it must hold no NaN.
"""

import inspect
import os
import tempfile
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from odd_values import odd

import pmalpha as pm

HDF5 = find_spec("h5py") is not None
K3 = np.array([[4.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 2.0]])
QUAD = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def bell(u):
    """The derivative of arctan, without overflow."""
    return np.cos(np.arctan(u)) ** 2


def one(rng, *values):
    return values[int(rng.integers(len(values)))]


def scheme(rng):
    return one(
        rng,
        pm.GeneralizedAlpha(0.5),
        pm.GeneralizedAlpha(0.8, explicit=True),
        pm.Newmark(),
        pm.CentralDifference(),
    )


def sides(**changes):
    """Two subdomains and their tie."""
    a = {"M": np.ones(3), "K": K3, "u0": [1.0, 0.5, 0.2], "scheme": pm.GeneralizedAlpha(0.5)}
    b = {"M": np.ones(2), "K": sp.csr_array(np.diag([3.0, 3.0])), "u0": [0.2, 0.0]}
    a = pm.Subdomain(name="a", **(a | changes))
    b = pm.Subdomain(name="b", substeps=4, scheme=pm.GeneralizedAlpha(0.5), **b)
    return a, b, pm.tie(a, [2], b, [0])


def coupled(rng, **options):
    a, b, tie = sides()
    coupling = one(rng, "pm", "gc", "macro", "mean")
    coupler = pm.Coupler([a, b], tie, dt=0.05, **({"coupling": coupling} | options))
    coupler.step(int(rng.integers(3)))
    return coupler


# ---- describe --------------------------------------------------------------------------------


def matrices(rng):
    """M, K, C in a random format each."""
    forms = (np.array, sp.csr_array, sp.coo_matrix, sp.csc_array, sp.lil_array, sp.dia_array)
    M, K, C = np.diag([1.0, 2.0, 1.0]), K3, 0.1 * K3
    M, K, C = (one(rng, *forms)(A) for A in (M, K, C))
    return {"M": one(rng, M, np.array([1.0, 2.0, 1.0])), "K": K, "C": one(rng, C, None)}


def forces(rng):
    return one(
        rng,
        np.array([1.0, 0.0, 2.0]),
        lambda t: np.array([np.sin(t), 0.0, 1.0]),
        pm.SampledForce(np.sin(np.arange(9.0)), 0.05, shape=np.ones(3)),
        None,
    )


def subdomain(rng):
    values = matrices(rng) | {"scheme": scheme(rng), "substeps": 2, "force": forces(rng)}
    values |= {"u0": np.array([0.1, 0.2, 0.3]), "v0": np.zeros(3), "name": "a"}
    extra = one(
        rng,
        {"restoring": lambda t, u, v: 0.1 * np.tanh(u)},
        {"restoring": pm.CubicSpring([0], k=1.0, k3=2.0), "restoring_damping": 0.1 * np.eye(3)},
        {"internal": lambda t, u, v, q: (np.arctan(u), np.diag(bell(u)))},
        {"internal": [pm.Bilinear([0, 1], k=2.0, fy=[0.1, 0.2]), pm.Gap([2], k=5.0, gap=0.1)]},
        {"rayleigh": (0.1, 0.01)},
        {"damping": "lagged", "scheme": pm.GeneralizedAlpha(0.0, explicit=True)},
        {"symmetric": False, "C": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.1]])},
        {"double_step": True},
    )
    return pm.Subdomain, values | extra, advanced


def callback(rng):
    """What a load, a restoring force and an internal force return."""
    values = {"force": np.ones(3), "restoring": np.ones(3), "internal": (np.ones(3), np.eye(3))}
    name = one(rng, *values)

    def call(**returned):
        a, b, tie = sides(**{name: lambda *_: returned[name]})
        return pm.Coupler([a, b], tie, dt=0.05, coupling=one(rng, "pm", "macro"))

    return call, {name: values[name]}, steps


def schemes(rng):
    return *one(
        rng,
        (pm.GeneralizedAlpha, {"rho": 0.5, "explicit": False}),
        (pm.Newmark, {"beta": 0.25, "gamma": 0.5}),
        (pm.HHT, {"alpha": 0.1}),
        (pm.WBZ, {"alpha": 0.1}),
        (pm.Scheme, {"am": 0.0, "af": 0.1, "beta": 0.3, "gamma": 0.6, "explicit": False}),
    ), lambda scheme: pm.solve(pm.Subdomain([1.0], [4.0], scheme=scheme, u0=[1.0]), 0.1, 1.0)


def sampled(rng):
    load = one(
        rng,
        (pm.SampledForce, {"values": np.sin(np.arange(9.0)), "dt": 0.05, "shape": np.ones(3)}),
        (pm.SampledForce, {"values": np.ones((9, 2)), "dt": 0.05, "shape": np.ones((3, 2))}),
        (
            pm.BaseAcceleration,
            {"record": np.ones(9), "dt": 0.05, "direction": np.ones(3), "M": np.ones(3)},
        ),
    )
    return *load, lambda force: solved(force=force)


def springs(rng):
    kinds = (
        (pm.CubicSpring, {"dofs": [0, 1], "k": 1.0, "k3": np.array([0.5, 1.0])}),
        (pm.Gap, {"dofs": [(0, 1)], "k": 5.0, "gap": 0.1}),
        (pm.Bilinear, {"dofs": np.array([0, 2]), "k": 2.0, "fy": [0.1, 0.2], "hardening": 0.1}),
        (pm.BoucWen, {"dofs": [0], "k": 2.0, "fy": 0.1, "n": 1.0, "beta": 0.5, "gamma": 0.5}),
    )
    where = one(rng, "restoring", "internal")
    return *one(rng, *kinds), lambda spring: solved(**{where: spring})


def internal_force(rng):
    values = {"history": np.zeros(3), "pattern": sp.csr_array(np.eye(3))}
    values |= {"evaluate": lambda t, u, v, q: (np.arctan(u), np.diag(bell(u)), None, q + u)}
    return pm.InternalForce, values, lambda force: solved(internal=force)


def newton(rng):
    def use(newton):
        a, b, tie = sides(internal=pm.CubicSpring([0], k=1.0, k3=2.0))
        return steps(pm.Coupler([a, b], tie, dt=0.05, newton=newton, coupling="pm"))

    return pm.Newton, {"tol": 1e-8, "iterations": 40, "tangent": "full"}, use


def constraint(rng):
    a, b, _ = sides()
    matrices = {"a": np.array([[0.0, 0.0, 1.0]]), b: sp.csr_array([[-1.0, 0.0]])}
    velocity = one(rng, None, lambda t: [np.sin(t)], pm.SampledForce(np.arange(9.0), 0.1))

    def use(constraint):
        return steps(pm.Coupler([a, b], constraint, dt=0.05, coupling="pm"))

    return pm.Constraint, {"matrices": matrices, "velocity": velocity}, use


def tie(rng):
    a, b, _ = sides()
    values = {"a": one(rng, a, "a"), "dofs_a": [1, 2], "b": b, "dofs_b": np.array([0, 1])}

    def use(constraint):
        return pm.Coupler([a, b], constraint, dt=0.05, coupling="pm")

    return pm.tie, values, use


def coincident(rng):
    a, b, _ = sides()
    points = {a: np.arange(3.0)[:, None], b: np.array([[2.0], [3.0]])}
    values = {"points": points, "components": 1, "dofs_per_node": one(rng, None, 1), "tol": 1e-6}
    return pm.tie_coincident, values, lambda c: pm.Coupler([a, b], c, dt=0.05, coupling="pm")


def interpolated(rng):
    plate = pm.structures.plate(1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
    b = plate.subdomain(scheme=pm.Newmark(), name="b")
    a = pm.Subdomain(np.ones(4), np.ones(4), scheme=pm.Newmark(), name="a")
    values = {"a": a, "points_a": np.array([[0.5, 0.0], [1.0, 0.25]]), "b": b, "components": 2}
    values |= {"points_b": QUAD, "elements_b": np.array([[0, 1, 2, 3]]), "tol": 1e-6}
    return (
        pm.interpolate,
        values | {"cell": "quad"},
        lambda c: pm.Coupler([a, b], c, dt=0.05, coupling="pm"),
    )


def reduction(rng):
    values = matrices(rng) | {"fixed": one(rng, [0], np.array([True, False, False]))}
    return pm.reduce, values, lambda r: (r.M, r.K, r.C)


def coupler(rng):
    a, b, tie = sides()
    values = {"subdomains": [a, b], "constraints": one(rng, tie, [tie]), "dt": 0.05, "threads": 2}
    values |= {"coupling": one(rng, "pm", "gc", "macro", "mean"), "start": "rebased"}
    return pm.Coupler, values, steps


# ---- advance ---------------------------------------------------------------------------------


def run(rng):
    values = {"steps": 5, "every": 2, "record": {"a": [0, 1], "b": None}, "energy": True}
    values |= one(rng, {}, {"outputs": {"a": {"N": np.ones(3), "S": {"u": K3, "v": np.eye(3)}}}})
    values |= one(rng, {}, {"progress": lambda done, total: None}, {"record_springs": {}})
    if rng.random() < 0.3:
        del values["steps"]
        values["t_end"] = 1.0
    return coupled(rng).run, values, None


def tolerance(rng):
    values = {"t_end": 0.5, "tolerance": one(rng, 1e-2, {"a": 1e-2, "b": 1e-2})}
    return coupled(rng, coupling="gc").run, values, None


def solve(rng):
    s = sides()[0]
    return pm.solve, {"subdomain": s, "dt": 0.05, "t_end": 0.5, "threads": 1}, None


def reset(rng):
    c = coupled(rng, coupling=one(rng, "pm", "macro"))
    values = {"u0": {"a": np.ones(3), "b": [1.0, 0.0]}, "v0": {"a": np.zeros(3)}}
    return c.reset, values | {"force": {"a": forces(rng)}}, lambda _: steps(c)


def run_each(rng):
    """Cases side by side and one by one; their files are in a folder that is removed again."""
    cases = [{"u0": {"a": [0.1 * k, 0.0, 0.0]}, "force": {"b": [k, 1.0]}} for k in range(4)]
    cases[1] |= {"force": {"a": forces(rng)}}
    cases += one(rng, [], 6 * [{"v0": {"a": np.array([0.0, 0.1, 0.0])}}])
    values = {"cases": cases, "steps": 3, "every": 1, "record": {"a": [0, 2], "b": None}}
    values |= one(rng, {}, {"energy": False}, {"outputs": {"a": {"N": np.ones(3)}}})
    values |= one(rng, {}, {"progress": lambda done, total: None})
    names = [f"{k}.h5" for k in range(len(cases))]
    values |= {"record_to": names} if HDF5 and rng.random() < 0.3 else {}
    c = coupled(rng)
    call = in_folder(c.run_each, "record_to")
    return call, values, lambda found: [found, steps(c)]


def snapshots(rng):
    """Snapshots of this coupler, of another one of the same problem, and of none."""
    c, other = coupled(rng), coupled(rng)
    own = c.snapshot()
    c.step(2)
    return c.restore, {"snapshot": one(rng, own, other.snapshot())}, lambda _: steps(c)


def change_steps(rng):
    c = coupled(rng)
    return c.change_steps, {"dt": 0.025, "substeps": {"a": 2, "b": 4}}, lambda _: steps(c)


def state(rng):
    c = coupled(rng)
    return *one(
        rng,
        (c.state, {"key": "a"}),
        (lambda n: c.step(min(n, 2**6) if isinstance(n, int) else n), {"n": 3}),
        (c.modes, {"k": 2}),
        (lambda key: c.run(steps=2)[key], {"key": "b"}),
    ), None


def study(rng):
    values = {"make_coupler": lambda: coupled(rng), "t_end": 1.0, "together": 2, "every": 2}
    return (
        pm.Study,
        values,
        lambda s: [x.value for x in s.run([{}, {"v0": {"a": [0.0, 0.1, 0.0]}}])],
    )


def made():
    return coupled(np.random.default_rng(0))


def study_run(rng):
    """Cases of a study, one of which may fail, and its file."""
    returned = {"u": np.arange(3.0), "t": 1.0}
    result = one(rng, None, lambda history: odd_result, partial(dict, u=1.0))
    odd_result = odd(rng, returned)
    make = one(rng, made, lambda: coupled(rng), partial(coupled, rng), partial(coupled, None))
    s = pm.Study(make, steps=3, result=result, together=int(rng.integers(1, 4)))
    values = {"cases": [{}, {"v0": {"a": [0.0, 0.1, 0.0]}}, {"force": {"b": [1.0, 0.0]}}]}
    values |= {"save_to": "study.h5"} if HDF5 and rng.random() < 0.5 else {}
    # what `result` returns is its own affair, NaN too
    return in_folder(s.run, "save_to"), values | {"progress": None, "map": map}, len


# ---- files and pictures ------------------------------------------------------------------------


def written(rng):
    """Files for ParaView, in a folder that is removed again."""
    u = np.zeros((3, 8))
    values = {"path": one(rng, "x.xdmf", "x.pvd"), "points": QUAD, "elements": [[0, 1, 2, 3]]}
    values |= {"times": np.arange(3.0), "u": u, "v": one(rng, None, u), "most_times": 2}
    values |= {"data": {"T": np.zeros((3, 4))}, "cells": {"part": [1.0]}}

    return in_folder(pm.export.write_series, "path"), values, None


def in_folder(function, name):
    """The function with this argument, a path or a list of them, in a folder that is removed."""

    def within(folder, x):
        if isinstance(x, list | tuple):
            return [within(folder, y) for y in x]
        # nothing is written elsewhere
        return Path(folder, Path(os.fsdecode(x)).name) if isinstance(x, str | bytes) else x

    def called(**values):
        with tempfile.TemporaryDirectory() as folder:
            values |= {name: within(folder, values[name])} if name in values else {}
            return function(**values)

    called.__signature__ = inspect.signature(function)
    called.__name__ = function.__name__
    return called


def pictures(rng):
    """Drawn and closed again."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    history = coupled(rng).run(steps=5, energy=True)
    plate = pm.structures.plate(2, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
    u = 0.1 * np.ones(plate.n)
    mesh = {"points": plate.points, "elements": plate.elements}
    function, values = one(
        rng,
        (history.plot, {"dofs": {"a": [0, 1]}, "quantity": "v", "title": "x"}),
        (history["a"].plot, {"quantity": "u", "dofs": [0, 1]}),
        (pm.plot.deformed, mesh | {"u": u, "scale": 2.0}),
    )
    return function, values, lambda _: plt.close("all")


def animations(rng):
    """Some of the frames, drawn and closed again."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plate = pm.structures.plate(2, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
    held = pm.reduce(plate.M, plate.K, fixed=[0, 1])
    free = pm.Subdomain(held.M, held.K, scheme=pm.Newmark(), u0=np.ones(held.M.shape[0]), name="f")
    whole = plate.subdomain(scheme=pm.Newmark(), u0=np.linspace(0.0, 1.0, plate.n), name="w")
    history = pm.Coupler([free, whole], dt=0.1, coupling="pm").run(steps=3)
    meshes = {"f": (plate, held.expand), "w": one(rng, plate, (plate.points, plate.elements))}
    values = {"history": history, "meshes": meshes, "frames": 4, "interval": 20.0, "scale": 2.0}
    values |= one(rng, {}, {"values": lambda u: u[:, 0], "value_label": "x"})

    def drawn(animation):
        animation._func(animation._save_count - 1)
        animation._draw_was_started = True  # else it warns that nobody has seen it
        plt.close("all")

    return pm.plot.animation, values, drawn


# ---- structures, analysis, models ------------------------------------------------------------


def lines(rng):
    s, points, members = pm.structures, QUAD, np.array([[0, 1], [1, 2], [2, 3]])
    on = {"points": points, "members": members, "divisions": 2}
    return *one(
        rng,
        (s.chain, {"n": 3, "mass": 1.0, "stiffness": np.ones(2), "ground": (1.0, 0.0)}),
        (s.rod, {"n": 3, "length": 1.0, "EA": 1.0, "rhoA": np.ones(3), "mass": "lumped"}),
        (s.truss, on | {"EA": 1.0, "rhoA": 1.0, "strain": "green", "prestress": 0.1}),
        (s.truss, on | {"EA": 1.0, "rhoA": 1.0, "slack": True, "unstressed": np.ones(3)}),
        (s.beam_frame, on | {"EA": 1.0, "EI": 1.0, "rhoA": 1.0, "mass": "consistent"}),
        (s.corotational_frame, on | {"EA": 1.0, "EI": 1.0, "rhoA": 1.0, "rotary": 0.01}),
        (s.subdivide, on),
    ), structure


def solids(rng):
    s, material = pm.structures, {"E": 1.0, "nu": 0.3, "rho": np.float64(1.0)}
    cube = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in QUAD])
    return *one(
        rng,
        (s.plate, {"nx": 2, "ny": 1, "h": 0.5, **material, "t": 0.1, "plane": "strain"}),
        (s.plate_on, {"points": QUAD, "elements": np.array([[0, 1, 2, 3]]), **material}),
        (s.plate_on, {"points": QUAD, "elements": {"triangle": [[0, 1, 2]]}, **material}),
        (s.solid, {"nx": 1, "ny": 1, "nz": 2, "h": (1.0, 1.0, 0.5), **material}),
        (s.solid_on, {"points": cube, "elements": np.arange(8)[None], **material}),
        (
            s.nonlinear_solid,
            {"counts": (2, 1), "h": 0.5, "material": s.NeoHookean(1.0, 0.3), "rho": 1.0},
        ),
        (
            s.nonlinear_solid_on,
            {"points": QUAD, "elements": [[0, 1, 2, 3]], "material": plastic(), "rho": 1.0},
        ),
        (s.submesh, {"points": QUAD, "elements": np.array([[0, 1, 2, 3]])}),
    ), structure


def plastic():
    return pm.structures.J2Plasticity(1.0, 0.3, 0.1, isotropic=0.1)


def materials(rng):
    s = pm.structures
    values = {"E": 1.0, "nu": 0.3}
    more = {"yield_stress": 0.1, "isotropic": 0.1, "kinematic": 0.0}
    kind = one(
        rng, (s.NeoHookean, values), (s.StVenantKirchhoff, values), (s.J2Plasticity, values | more)
    )
    return *kind, lambda m: structure(s.nonlinear_solid(1, 1, 1.0, m, rho=1.0))


def contact(rng):
    s = pm.structures
    bar = s.chain(3, 1.0, 1.0)
    block = s.plate(1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
    plane = {"structure": block, "nodes": [0, 1], "stiffness": 10.0}
    plane |= {"point": [0.0, -0.1], "normal": [0.0, 1.0]}
    ball = {"structure": block, "nodes": [0], "center": [0.0, -2.0], "radius": 1.0}
    ball |= {"stiffness": 10.0, "inside": False}
    modes = {"M": bar.M, "K": K3, "k": 2, "fixed": None}
    return *one(rng, (s.plane_contact, plane), (s.sphere_contact, ball), (s.modes, modes)), None


def elements(rng):
    values = {
        "dofs": np.array([[0, 1], [1, 2]]),
        "M": np.ones((2, 2)),
        "K": 2 * [[[1, -1], [-1, 1]]],
    }
    return pm.Elements, values, lambda e: cut_of(structure=e, labels=[0, 1], dt=0.1)


def cut(rng):
    plate = pm.structures.plate(4, 1, (0.1, 0.2), E=1.0, nu=0.3, rho=1.0)
    values = {"structure": plate, "dt": 0.05, "fixed": [0, 1, 10, 11], "u0": np.zeros(plate.n)}
    values |= {"rayleigh": (0.1, 0.001), "force": np.zeros(plate.n)}
    values |= one(
        rng,
        {"labels": [0, 0, 1, 1], "scheme": pm.GeneralizedAlpha(0.5)},
        {"parts": 2},
        {"labels": "steps", "scheme": pm.GeneralizedAlpha(0.5, explicit=True)},
    )
    return cut_of, values, None


def of_cut(rng):
    """What is done with a Cut: its plan, loads of the whole, results of the whole."""
    plate = pm.structures.plate(4, 1, (0.1, 0.2), E=1.0, nu=0.3, rho=1.0)
    schemes = {"left": pm.Newmark(), "right": pm.GeneralizedAlpha(0.5, explicit=True)}
    labels = ["left", "left", "right", "right"]
    cut = pm.cut(plate, labels, dt=0.01, scheme=schemes, fixed=[0, 1], u0=np.zeros(plate.n))
    history = cut.coupler(coupling="pm").run(steps=3)
    path = one(rng, "x.xdmf", "x.pvd")
    return *one(
        rng,
        (cut.plan, {"dt": 0.02}),
        (cut.scatter, {"u": np.arange(plate.n) * 1.0}),
        (cut.gather, {"history": history}),
        (cut.coupler, {"dt": 0.02, "coupling": "gc", "threads": 1}),
        (in_folder(cut.export, "path"), {"path": path, "history": history}),
    ), lambda found: steps(found) if isinstance(found, pm.Coupler) else found


def cut_model(rng):
    """Ready-made and nonlinear structures, cut."""
    s, common = pm.structures, {"EA": 1.0, "rhoA": 1.0}
    square = {"points": QUAD, "members": [[0, 1], [1, 2], [2, 3], [3, 0]], "divisions": 2}
    structure, fixed = one(
        rng,
        (s.chain(5, 1.0, 1.0), [0]),
        (s.rod(4, 1.0, EA=1.0, rhoA=1.0, mass="lumped"), 0),
        (s.truss(**square, **common, strain="green", prestress=0.1), [0, 1, 2, 3]),
        (s.beam_frame(**square, **common, EI=1.0), [0, 1, 2]),
        (s.corotational_frame(**square, **common, EI=1.0, rotary=0.1), [0, 1, 2]),
        (s.nonlinear_solid(4, 1, 0.5, s.NeoHookean(1.0, 0.3), rho=1.0), [0, 1]),
        (s.nonlinear_solid(4, 1, 0.5, plastic(), rho=1.0), [0, 1]),
    )
    count = sum(len(x) for x in structure.elements.values())
    values = {"structure": structure, "dt": 0.02, "fixed": fixed, "rayleigh": (0.1, 0.0)}
    values |= {"labels": np.arange(count) * 2 // count, "v0": np.zeros(structure.n)}
    values |= {"force": forces_on(rng, structure.n)}
    return cut_of, values | {"scheme": pm.GeneralizedAlpha(0.5)}, None


def forces_on(rng, n):
    return one(
        rng,
        np.ones(n),
        lambda t: np.full(n, np.sin(t)),
        pm.SampledForce(np.sin(np.arange(9.0)), 0.05, shape=np.ones(n)),
    )


def cut_of(**values):
    made = pm.cut(**values)
    return steps(made.coupler(dt=0.05, coupling="pm"))


def analysis(rng):
    x = pm.analysis
    record = {"record": np.sin(np.arange(20.0)), "dt": 0.1, "periods": [0.5, 1.0], "damping": 0.05}
    return *one(
        rng,
        (x.response_spectrum, record | {"free_vibration": True}),
        (x.amplification_matrix, {"coupler": coupled(rng)}),
        (x.critical_step, {"subdomain": sides()[0], "u": np.zeros(3)}),
        (x.spectral_radius, {"G": K3, "drop": [1.0], "tol": 1e-6}),
        (x.observed_order, {"run": lambda dt: min(dt, 1e9) ** 2, "steps": np.array([0.1, 0.05])}),
        (x.local_error, {"coupler": coupled(rng), "exact": lambda t: None, "n": 3}),
        (x.zero_stability, {"coupler": coupled(rng)}),
    ), None


def periods(rng):
    values = {"scheme": scheme(rng), "Omega": np.array([0.1, 0.5]), "xi": 0.02}
    return pm.analysis.period_and_damping, values, lambda _: None  # NaN where there is no period


def models(rng):
    m = pm.models
    return *one(
        rng,
        (m.split_oscillator, {"b1": 10.0, "rho": 0.5, "substeps": 2, "mass": 1.0, "u0": 1.0}),
        (m.four_dof, {"rho": 0.5, "substeps": 20}),
        (m.rayleigh, {"omegas": (1.0, 5.0), "ratios": (0.02, 0.05)}),
        (m.modal_damping, {"M": np.ones(3), "K": K3, "ratios": [0.02, 0.05]}),
        (m.shear_frame, {"masses": np.ones(3), "stiffnesses": [2.0, 1.0, 1.0]}),
        (pm.readers.asymmetry, {"A": K3}),
        (pm.readers.symmetrized, {"A": sp.csr_array(K3), "tol": 1e-9}),
        (pm.readers.completed, {"A": np.tril(K3)}),
        (pm.SupportMotion, {"record": np.sin(np.arange(9.0)), "dt": 0.1, "kind": "acceleration"}),
    ), None


ENTRIES = (subdomain,) * 5 + (callback, coupler, constraint, tie, run, run) * 2
ENTRIES += (schemes, sampled, springs, internal_force, newton, coincident, interpolated, reduction)
ENTRIES += (tolerance, solve, reset, run_each, change_steps, state, study, lines, solids, materials)
ENTRIES += (pictures, animations) if find_spec("matplotlib") else ()
ENTRIES += (study_run, study_run, written, contact, elements, cut, cut_model, of_cut, snapshots)
ENTRIES += (analysis, periods, models)


# ---- what is done with results ---------------------------------------------------------------


def steps(coupler):
    return coupler.run(steps=3, energy=coupler.coupling != "mean")


def advanced(s):
    """A run of this subdomain, alone or beside another one."""
    b = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="beside", u0=[s.u0[s.n - 1]])
    b = b if s.name != "beside" else pm.Subdomain([1.0], [4.0], scheme=pm.Newmark())
    return pm.Coupler([s, b], dt=0.01 * s.substeps, coupling="pm").run(steps=3)


def solved(**changes):
    return pm.solve(sides(**changes)[0], 0.05, 0.5)


def structure(found):
    if not isinstance(found, pm.structures.Structure):
        return found
    s = found.subdomain(scheme=pm.GeneralizedAlpha(0.5))
    return found.M, found.K, found.points, pm.solve(s, 0.01, 0.03)
