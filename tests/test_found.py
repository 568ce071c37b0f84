"""What the campaign with odd input has found: each is refused by name now."""

from fractions import Fraction
from importlib.util import find_spec

import numpy as np
import pytest
import scipy.sparse as sp
from refusals import coupled, refused, single

import pmalpha as pm
from pmalpha.cutting.division import Division

MASSES, K = np.ones(3), np.diag([4.0, 4.0, 2.0])
BLOCK = pm.structures.plate(1, 1, 1.0, E=1.0, nu=0.3, rho=1.0)
BETA = pm.Newmark()
MOTION = [[0.0], [1.0]], [[0, 1]], [0.0], [[0.0, 0.0]]
PLANE = {"nodes": [0], "point": [0.0, 0.0], "stiffness": 1.0}
HUGE = np.array([[0.0, 0.0], [1e308, 0.0], [1e308, 1e308], [0.0, 1e308]])


def damaged_blocks():
    A = sp.bsr_array(np.eye(3))
    A.indices = np.concatenate([A.indices, A.indices])
    return A


def unused_blocks():
    A = sp.bsr_array(np.eye(3))
    A.indptr = np.zeros_like(A.indptr)
    return A


def moving(mesh=([[0.0]], [[0]]), **options):
    history = pm.Coupler([single()], dt=0.1).run(steps=1)
    return pm.plot.animation(history, {0: mesh}, **options)


def picture(dofs):
    return pm.Coupler([single()], dt=0.1).run(steps=1).plot(dofs)


def longer_data():
    A = sp.csc_array(np.ones((1, 3)))
    A.data = np.concatenate([A.data, A.data])
    return A


def with_objects():
    A = sp.csr_array(np.eye(3))
    A.data = A.data.astype(object)
    return A


REFUSED = {
    "a plane on no structure": (
        lambda: pm.structures.plane_contact(np.eye(3), normal=[0.0, 1.0], **PLANE),
        TypeError,
        "structure must be a Structure",
    ),
    "a normal of infinite length": (
        lambda: pm.structures.plane_contact(BLOCK, normal=[1e308, 1.5e308], **PLANE),
        ValueError,
        "normal must",
    ),
    "too many divisions": (
        lambda: pm.structures.subdivide([[0, 0], [1, 0]], [[0, 1]], 2**63),
        ValueError,
        "divisions must be at most",
    ),
    "points out of range": (
        lambda: pm.structures.plate_on(HUGE, [[0, 1, 2, 3]], E=1.0, nu=0.3, rho=1.0),
        ValueError,
        "points must not exceed",
    ),
    "points to interpolate between out of range": (
        lambda: pm.interpolate("a", [[0.5, 0.5]], "b", HUGE, [[0, 1, 2, 3]]),
        ValueError,
        "points of 'b' must not exceed",
    ),
    "masses that are an iterator": (
        lambda: pm.models.shear_frame(iter([1.0]), [1.0]),
        TypeError,
        "masses must hold real numbers",
    ),
    "three frequencies": (
        lambda: pm.models.rayleigh([1.0, 2.0, 3.0], [0.1, 0.1]),
        ValueError,
        "omegas must have shape (2,)",
    ),
    "lists of ratios": (
        lambda: pm.models.rayleigh([1.0, 2.0], [0.1, [0.1]]),
        ValueError,
        "ratios must be a regular array",
    ),
    "a complex displacement": (
        lambda: pm.models.split_oscillator(10.0, u0=1j),
        TypeError,
        "u0 must be a real number",
    ),
    "a tolerance in words": (
        lambda: pm.analysis.spectral_radius(K, tol="x"),
        TypeError,
        "tol must be a real number",
    ),
    "eigenvalues in words": (
        lambda: pm.analysis.spectral_radius(K, drop=["x"]),
        TypeError,
        "drop must be a sequence of numbers",
    ),
    "an order of no function": (
        lambda: pm.analysis.observed_order({}, [0.1, 0.2]),
        TypeError,
        "run must be callable",
    ),
    "steps that are one flag": (
        lambda: pm.analysis.observed_order(abs, True),
        TypeError,
        "steps must hold real numbers",
    ),
    "a flag that is a matrix": (
        lambda: pm.analysis.response_spectrum(
            MASSES, 0.1, [1.0], free_vibration=sp.dia_array(np.eye(3))
        ),
        TypeError,
        "free_vibration must be True or False",
    ),
    "a step with an infinite square": (
        lambda: pm.analysis.response_spectrum(MASSES, 1e308, [1.0]),
        ValueError,
        "dt must have a finite square",
    ),
    "frequencies out of range": (
        lambda: pm.analysis.period_and_damping(pm.Newmark(), [1e307]),
        ValueError,
        "Omega must not exceed",
    ),
    "parameters out of range": (lambda: pm.Newmark(5e-324), ValueError, "beta must be 0 or"),
    "a parameter out of range": (lambda: pm.Newmark(0.25, 1e308), ValueError, "gamma must"),
    "constraints that are an array": (
        lambda: pm.Coupler([single()], np.array(1.0), dt=0.1),
        TypeError,
        "constraints must be Constraints",
    ),
    "cases that are an array": (
        lambda: pm.Coupler([single()], dt=0.1).run_each(np.array(1.0), steps=1),
        TypeError,
        "cases must be a list of dicts",
    ),
    "a ragged step": (
        lambda: pm.Coupler([single()], dt=[[1.0, 2.0], [3.0]]),
        ValueError,
        "dt must be a regular array",
    ),
    "a ragged velocity": (
        lambda: pm.Constraint({"a": [[1.0]]}, velocity=[[1.0, 2.0], [3.0]]),
        ValueError,
        "velocity must be a regular array",
    ),
    "a dof out of range": (
        lambda: pm.tie("a", [2**63 - 1], "b", [0]),
        ValueError,
        "dofs_a must be below",
    ),
    "a record with a row for each sample": (
        lambda: pm.BaseAcceleration([[1.0, 2.0]], 0.1, [1.0, 1.0], [1.0, 1.0]),
        ValueError,
        "direction must have a column for each of the 2 series of record",
    ),
    "a load out of range": (
        lambda: pm.SampledForce([1e200], 0.1, shape=[1e200]),
        ValueError,
        "values times shape must be finite",
    ),
    "a mass times a direction out of range": (
        lambda: pm.BaseAcceleration([1.0], 0.1, [1e200], [1e200]),
        ValueError,
        "M times direction must be finite",
    ),
    "a motion out of range": (
        lambda: pm.SupportMotion([0.0, 1e308], 0.1, "acceleration"),
        ValueError,
        "record must not exceed",
    ),
    "a damaged matrix of blocks": (
        lambda: pm.Subdomain(damaged_blocks(), K, scheme=pm.Newmark()),
        ValueError,
        "M must have as many indices as blocks",
    ),
    "a pattern of objects": (
        lambda: pm.InternalForce(lambda *_: None, pattern=with_objects()),
        TypeError,
        "pattern must hold real numbers",
    ),
    "subdomains that are a sparse matrix": (
        lambda: pm.Coupler(sp.dia_array(np.eye(3)), dt=0.1, coupling="pm"),
        TypeError,
        "subdomains must be a list of Subdomains",
    ),
    "a damping whose differences overflow": (
        lambda: pm.Subdomain(MASSES, K, 1e308 * (np.eye(3, k=1) - np.eye(3, k=-1)), scheme=BETA),
        ValueError,
        "C must be symmetric",
    ),
    "a damping of whole numbers without a sign": (
        lambda: pm.Subdomain(
            MASSES, K, np.array([[0, 1, 0], [2**64 - 1, 0, 0], [0, 0, 0]], "u8"), scheme=BETA
        ),
        ValueError,
        "C must be symmetric",
    ),
    "modes of a mass that is nearly zero": (
        lambda: pm.models.modal_damping([1.0, 1.0, 5e-324], K, [0.02]),
        ValueError,
        "M must be so large that K_ii / M_ii is finite, which it is not at 2",
    ),
    "modal damping of negative masses": (
        lambda: pm.models.modal_damping(-MASSES, K, [0.02]),
        ValueError,
        "ratios must be at most 0, one for each dof with mass",
    ),
    "a spectrum with periods far below the step": (
        lambda: pm.analysis.response_spectrum(MASSES, 2.0**70, [1.0]),
        ValueError,
        "periods must be 0 or at least dt / 1e+06",
    ),
    "a prestress out of range": (
        lambda: pm.structures.truss([[0, 0], [1, 0]], [[0, 1]], EA=1.0, rhoA=1.0, prestress=1e155),
        ValueError,
        "prestress must not exceed",
    ),
    "fields that are no dict": (
        lambda: pm.export.write_series("x.xdmf", *MOTION, data=[("T", [[0.0, 1.0]])]),
        TypeError,
        "data must be a dict",
    ),
    "numbers of elements that are no dict": (
        lambda: pm.export.write_series("x.xdmf", *MOTION, cells=[1.0]),
        TypeError,
        "cells must be a dict",
    ),
    "a study of no cases": (
        lambda: pm.Study(list, steps=1).run(np.array(1.0)),
        TypeError,
        "cases must be dicts of what reset takes",
    ),
    "a map that returns nothing": (
        lambda: pm.Study(list, steps=1).run([{}], map=lambda *_: None),
        TypeError,
        "map must return an iterable of results, got None",
    ),
    "a picture of a list of quantities": (
        lambda: pm.Coupler([single()], dt=0.1).run(steps=1).plot(quantity=["u"]),
        ValueError,
        "quantity must be 'u', 'v' or 'a', got",
    ),
    "fixed dofs of several kinds": (
        lambda: pm.cut(BLOCK, [0], fixed=[0, print]),
        TypeError,
        "fixed must be",
    ),
    "modes of a mass whose shift overflows": (
        lambda: pm.structures.modes([1.0, -1e308, 1.0], K, 1),
        ValueError,
        "M must have entries that are finite times K_ii / M_ii, got up to 1e+308",
    ),
    "a picture of displacements out of range": (
        lambda: pm.plot.deformed([[0.0], [1.0]], [[0, 1]], [[0.0], [1e308]], scale=2.0),
        ValueError,
        "points + scale u must be finite, got inf at [1, 0]",
    ),
    "a picture of ragged dofs": (
        lambda: picture([[1.0, 2.0], [3.0]]),
        ValueError,
        "must be a regular array",
    ),
    "a picture of a dof beyond 64 bits": (
        lambda: picture([2**70, 1]),
        ValueError,
        "dofs of 'subdomain 0' must lie in 0..0, got 1180591620717411303424",
    ),
    "a picture of a dof that is a fraction": (
        lambda: picture([Fraction(0), 0]),
        TypeError,
        "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got Fraction(0, 1)",
    ),
    "a picture of a dof that is nothing": (
        lambda: picture([None]),
        TypeError,
        "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got None",
    ),
    "a picture of dofs in a sparse matrix": (
        lambda: picture(sp.dia_array(np.eye(3))),
        TypeError,
        "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got <DIA",
    ),
    "a picture of ragged constraints": (
        lambda: coupled().run(steps=1).plot(constraints=[[0, 1], [0]]),
        ValueError,
        "constraints must be a regular array",
    ),
    "a record of a dof beyond 64 bits": (
        lambda: pm.Coupler([single()], dt=0.1).run(steps=1, record={0: [-(2**70)]}),
        ValueError,
        "record['subdomain 0'] must lie in -1..0, got -1180591620717411303424",
    ),
    "the motion of a dof beyond 64 bits": (
        lambda: pm.Coupler([single()], dt=0.1).state(0)[2**70],
        ValueError,
        "dof must lie in 0..0, got 1180591620717411303424",
    ),
    "a matrix with more data than indices": (
        lambda: pm.Constraint({"a": longer_data()}),
        ValueError,
        "L of 'a' must have as many indices as data, got 3 and 6, in a damaged csc matrix",
    ),
    "a record out of range": (
        lambda: pm.analysis.response_spectrum([0.0, -1e308, 1e308], 0.1, [1.0]),
        ValueError,
        "record must not exceed",
    ),
    "periods out of range": (
        lambda: pm.analysis.response_spectrum(MASSES, 0.1, [1e155]),
        ValueError,
        "periods must not exceed",
    ),
    "a sampling step out of range": (
        lambda: pm.analysis.response_spectrum(MASSES, 1e-308, [1.0]),
        ValueError,
        "dt and 1 / dt must not exceed",
    ),
    "a spring on a dof that is no integer": (
        lambda: pm.CubicSpring([2**63], k=1.0, k3=1.0),
        ValueError,
        "dofs must be below 9007199254740992, got 9223372036854775808",
    ),
    "springs on dofs that the subdomain does not have": (
        lambda: pm.Subdomain(0, K, scheme=BETA, internal=[pm.Gap([2], k=1.0, gap=0.0)]),
        ValueError,
        "internal[0]: dofs of a Gap must lie in 0..0, got 2",
    ),
    "a truss whose bars have no length in numbers": (
        lambda: pm.structures.truss([[0, 0], [1e-155, 0]], [[0, 1]], EA=1.0, rhoA=1.0),
        ValueError,
        "points must not all be below 1e-50, got at most 1e-155",
    ),
    "a motion with a step out of range": (
        lambda: pm.SupportMotion([0.0, 1.0], 5e-324, "acceleration"),
        ValueError,
        "dt and 1 / dt must not exceed",
    ),
    "damping ratios out of range": (
        lambda: pm.models.modal_damping(MASSES, K, [1e308, 0.05]),
        ValueError,
        "ratios must not exceed",
    ),
    "elements on a dof far away": (
        lambda: pm.cut(pm.Elements([[0, 2**62]], np.eye(2)[None], np.eye(2)[None]), [0]),
        ValueError,
        "structure must have an element at every dof in 0..4611686018427387904, not at dofs 1, 2",
    ),
    "a plan for a step of no length in numbers": (
        lambda: pm.cut(BLOCK, [0], dt=0.1).plan(5e-324),
        ValueError,
        "dt and 1 / dt must not exceed",
    ),
    "a picture of a scale out of range": (
        lambda: pm.plot.deformed([[0.0], [1.0]], [[0, 1]], [[0.0], [0.0]], scale=1e308),
        ValueError,
        "scale must not exceed",
    ),
    "a picture that moves of no history": (
        lambda: pm.plot.animation(None, {}),
        TypeError,
        "history must be a History or the motion of a mesh, got None",
    ),
    "a picture that moves of values that are no function": (
        lambda: moving(values=1.5),
        TypeError,
        "values must be callable or the name of a stress, got 1.5",
    ),
    "a picture that moves without text": (
        lambda: moving(value_label="\udcff"),
        ValueError,
        "value_label must be text, got '\\udcff'",
    ),
    "a picture that moves of a label that is no text": (
        lambda: moving(value_label=b"x"),
        TypeError,
        "value_label must be a str, got b'x'",
    ),
    "a picture that moves in no time": (
        lambda: moving(interval=float("nan")),
        ValueError,
        "interval must",
    ),
    "a picture that moves of a mesh that is none": (
        lambda: moving(1.5),
        TypeError,
        "meshes[0] must be a Structure or (points, elements)",
    ),
    "a picture that moves of a mesh with three arrays": (
        lambda: moving(([[0.0], [1.0]], [[0, 1]], [[0, 1]])),
        TypeError,
        "meshes[0] must be a Structure or (points, elements)",
    ),
    "blocks that no row has": (
        lambda: pm.reduce(np.eye(3), unused_blocks(), fixed=[0]),
        ValueError,
        "K must have 0 entries as its indptr has, got",
    ),
    "elements in a dictionary of keys": (
        lambda: pm.structures.plate_on(
            BLOCK.points, sp.dok_array(np.eye(4, dtype=int)), E=1.0, nu=0.3, rho=1.0
        ),
        ValueError,
        "elements must",
    ),
    "a picture of points without numbers": (
        lambda: moving((BLOCK, [None])),
        TypeError,
        "points of meshes[0] must",
    ),
    "a picture of other dofs": (
        lambda: moving(BLOCK),
        ValueError,
        "u of 'subdomain 0' for meshes[0] must have shape",
    ),
    "a picture of dofs that a reduction has not": (
        lambda: moving((BLOCK, pm.reduce(np.eye(8), np.eye(8), fixed=[0]).expand)),
        ValueError,
        "meshes[0] must have a function of u of 'subdomain 0'",
    ),
    "objects in place of numbers, by diagonals": (
        lambda: pm.readers.symmetrized(sp.dia_array(np.eye(2)).astype(object), tol=0.0),
        TypeError,
        "A must hold real numbers, got dtype object",
    ),
    "a scheme that is a matrix": (
        lambda: pm.cut(BLOCK, [0], dt=0.1, scheme=sp.dia_array(np.eye(3))),
        TypeError,
        "scheme must be a Scheme",
    ),
}


if not find_spec("matplotlib"):
    REFUSED = {what: x for what, x in REFUSED.items() if not what.startswith("a picture")}


@pytest.mark.parametrize("what", REFUSED)
def test_odd_input_is_refused_by_name(what):
    call, error, words = REFUSED[what]
    refused(error, call, words)


def test_parameters_of_schemes_are_floats_whatever_was_given():
    scheme = pm.Scheme(Fraction(0), Fraction(1, 4), Fraction(2, 5), np.float32(0.75))
    numbers = [scheme.am, scheme.af, scheme.beta, scheme.gamma]
    assert [type(x) for x in numbers] == 4 * [float]
    assert 0.0 < scheme.radius_at_infinity() < 1.0


def test_a_mass_so_small_that_frequencies_overflow_ends_as_instability():
    s = pm.Subdomain(1e-308 * MASSES, K + 0.1, scheme=pm.CentralDifference(), u0=MASSES)
    with pytest.warns(pm.StabilityWarning), pytest.raises(pm.InstabilityError):
        pm.Coupler([s], dt=0.1)


def test_springs_on_dofs_that_claim_more_than_there_is_memory_are_refused_at_once():
    with pytest.raises(MemoryError):
        pm.CubicSpring(np.broadcast_to([0], 2**50), k=1.0, k3=1.0)


def test_forces_at_the_start_that_overflow_end_as_instability():
    spring = pm.Gap([0], k=1.0, gap=0.1)  # 1.6e308 of K and 0.4e308 of the spring
    s = pm.Subdomain(MASSES, K, scheme=BETA, internal=[spring], u0=[4e307, 0.0, 0.0])
    with pytest.raises(pm.InstabilityError, match="macro step 0"):
        pm.Coupler([s], dt=0.1).step()


def test_shares_of_masses_whose_sum_overflows_are_those_of_smaller_ones():
    dofs = [np.array([0, 1]), np.array([1, 2])]
    small, large = (
        Division(3, dofs, [x * np.array([1.0, 1.0]), x * np.array([3.0, 1.0])])
        for x in (1.0, 0.5e308)
    )
    for own, other in zip(small.shares, large.shares):
        np.testing.assert_array_equal(own, other)
    np.testing.assert_array_equal(small.shares[0], [1.0, 0.25])


def test_masses_whose_squares_overflow_raise_no_warning():
    C = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    pm.Subdomain(np.array([1e308, 1.0, 1.0]), K, C, symmetric=False, scheme=pm.Newmark())


def test_a_step_whose_square_is_zero_raises_no_warning():
    # off the diagonal of M is more than on it: frequencies have no bound by sums of rows
    M = np.array([[1.0, 0.6, 0.6], [0.6, 1.0, 0.6], [0.6, 0.6, 1.0]])
    s = pm.Subdomain(M, K, scheme=pm.CentralDifference())
    pm.Coupler([s], dt=1e-308).step(3)
