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


# what the message has, and the call
VALUES = {
    "normal must": lambda: pm.structures.plane_contact(BLOCK, normal=[1e308, 1.5e308], **PLANE),
    "divisions must be at most": lambda: pm.structures.subdivide([[0, 0], [1, 0]], [[0, 1]], 2**63),
    "points must not exceed": lambda: pm.structures.plate_on(
        HUGE, [[0, 1, 2, 3]], E=1.0, nu=0.3, rho=1.0
    ),
    "points of 'b' must not exceed": lambda: pm.interpolate(
        "a", [[0.5, 0.5]], "b", HUGE, [[0, 1, 2, 3]]
    ),
    "omegas must have shape (2,)": lambda: pm.models.rayleigh([1.0, 2.0, 3.0], [0.1, 0.1]),
    "ratios must be a regular array": lambda: pm.models.rayleigh([1.0, 2.0], [0.1, [0.1]]),
    "dt must have a finite square": lambda: pm.analysis.response_spectrum(MASSES, 1e308, [1.0]),
    "Omega must not exceed": lambda: pm.analysis.period_and_damping(pm.Newmark(), [1e307]),
    "beta must be 0 or": lambda: pm.Newmark(5e-324),
    "gamma must": lambda: pm.Newmark(0.25, 1e308),
    "dt must be a regular array": lambda: pm.Coupler([single()], dt=[[1.0, 2.0], [3.0]]),
    "velocity must be a regular array": lambda: pm.Constraint(
        {"a": [[1.0]]}, velocity=[[1.0, 2.0], [3.0]]
    ),
    "dofs_a must be below": lambda: pm.tie("a", [2**63 - 1], "b", [0]),
    "direction must have a column for each of the 2 series of record": lambda: pm.BaseAcceleration(
        [[1.0, 2.0]], [1.0, 1.0], [1.0, 1.0], dt=0.1
    ),
    "values times shape must be finite": lambda: pm.SampledForce([1e200], 0.1, shape=[1e200]),
    "M times direction must be finite": lambda: pm.BaseAcceleration(
        [1.0], [1e200], [1e200], dt=0.1
    ),
    "record must not exceed": lambda: pm.SupportMotion([0.0, 1e308], 0.1, "acceleration"),
    "M must have arrays that fit: indices and data": lambda: pm.Subdomain(
        damaged_blocks(), K, scheme=pm.Newmark()
    ),
    "C must be symmetric": lambda: pm.Subdomain(
        MASSES, K, C=1e308 * (np.eye(3, k=1) - np.eye(3, k=-1)), scheme=BETA
    ),
    "M must be so large that K_ii / M_ii is finite, which it is not at 2": lambda: (
        pm.models.modal_damping([1.0, 1.0, 5e-324], K, [0.02])
    ),
    "ratios must be at most 0, one for each dof with mass": lambda: pm.models.modal_damping(
        -MASSES, K, [0.02]
    ),
    "periods must be 0 or at least dt / 1e+06": lambda: pm.analysis.response_spectrum(
        MASSES, 2.0**70, [1.0]
    ),
    "prestress must not exceed": lambda: pm.structures.truss(
        [[0, 0], [1, 0]], [[0, 1]], EA=1.0, rhoA=1.0, prestress=1e155
    ),
    "M must have entries that are finite times K_ii / M_ii, got up to 1e+308": lambda: (
        pm.structures.modes([1.0, -1e308, 1.0], K, 1)
    ),
    "record['subdomain 0'] must lie in -1..0, got -1180591620717411303424": lambda: pm.Coupler(
        [single()], dt=0.1
    ).run(steps=1, record={0: [-(2**70)]}),
    "dof must lie in 0..0, got 1180591620717411303424": lambda: pm.Coupler(
        [single()], dt=0.1
    ).state(0)[2**70],
    "L of 'a' must have arrays that fit: indices and data should have the same size": lambda: (
        pm.Constraint({"a": longer_data()})
    ),
    "periods must not exceed": lambda: pm.analysis.response_spectrum(MASSES, 0.1, [1e155]),
    "dt and 1 / dt must not exceed": lambda: pm.analysis.response_spectrum(MASSES, 1e-308, [1.0]),
    "dofs must be below 9007199254740992, got 9223372036854775808": lambda: pm.CubicSpring(
        [2**63], k=1.0, k3=1.0
    ),
    "internal[0]: dofs of a Gap must lie in 0..0, got 2": lambda: pm.Subdomain(
        0, K, scheme=BETA, internal=[pm.Gap([2], k=1.0, gap=0.0)]
    ),
    "points must not all be below 1e-50, got at most 1e-155": lambda: pm.structures.truss(
        [[0, 0], [1e-155, 0]], [[0, 1]], EA=1.0, rhoA=1.0
    ),
    "ratios must not exceed": lambda: pm.models.modal_damping(MASSES, K, [1e308, 0.05]),
    "must have an element at every dof in 0..4611686018427387904, not at dofs 1, 2": lambda: pm.cut(
        pm.Elements([[0, 2**62]], np.eye(2)[None], np.eye(2)[None]), [0]
    ),
    "K must have arrays that fit: 0 blocks by indptr, got 3": lambda: pm.reduce(
        np.eye(3), unused_blocks(), fixed=[0]
    ),
    "elements must": lambda: pm.structures.plate_on(
        BLOCK.points, sp.dok_array(np.eye(4, dtype=int)), E=1.0, nu=0.3, rho=1.0
    ),
}
TYPES = {
    "structure must be a Structure": lambda: pm.structures.plane_contact(
        np.eye(3), normal=[0.0, 1.0], **PLANE
    ),
    "masses must hold real numbers": lambda: pm.models.shear_frame(iter([1.0]), [1.0]),
    "u0 must be a real number": lambda: pm.models.split_oscillator(10.0, u0=1j),
    "tol must be a real number": lambda: pm.analysis.spectral_radius(K, tol="x"),
    "drop must be a sequence of numbers": lambda: pm.analysis.spectral_radius(K, drop=["x"]),
    "run must be callable": lambda: pm.analysis.observed_order({}, [0.1, 0.2]),
    "steps must hold real numbers": lambda: pm.analysis.observed_order(abs, True),
    "free_vibration must be True or False": lambda: pm.analysis.response_spectrum(
        MASSES, 0.1, [1.0], free_vibration=sp.dia_array(np.eye(3))
    ),
    "constraints must be Constraints": lambda: pm.Coupler([single()], np.array(1.0), dt=0.1),
    "cases must be a list of dicts": lambda: pm.Coupler([single()], dt=0.1).run_each(
        np.array(1.0), steps=1
    ),
    "pattern must hold real numbers": lambda: pm.InternalForce(
        lambda *_: None, pattern=with_objects()
    ),
    "subdomains must be a list of Subdomains": lambda: pm.Coupler(
        sp.dia_array(np.eye(3)), dt=0.1, coupling="pm"
    ),
    "data must be a dict": lambda: pm.export.write_series(
        "x.xdmf", *MOTION, data=[("T", [[0.0, 1.0]])]
    ),
    "cells must be a dict": lambda: pm.export.write_series("x.xdmf", *MOTION, cells=[1.0]),
    "cases must be dicts of what reset takes": lambda: pm.Study(list, steps=1).run(np.array(1.0)),
    "map must return an iterable of results, got None": lambda: pm.Study(list, steps=1).run(
        [{}], map=lambda *_: None
    ),
    "fixed must be": lambda: pm.cut(BLOCK, [0], fixed=[0, print]),
    "A must hold real numbers, got dtype object": lambda: pm.readers.symmetrized(
        sp.dia_array(np.eye(2)).astype(object), tol=0.0
    ),
    "scheme must be a Scheme": lambda: pm.cut(BLOCK, [0], dt=0.1, scheme=sp.dia_array(np.eye(3))),
}
VALUES_OF_PICTURES = {
    "quantity must be 'u', 'v' or 'a', got": lambda: (
        pm.Coupler([single()], dt=0.1).run(steps=1).plot(quantity=["u"])
    ),
    "points + scale u must be finite, got inf at [1, 0]": lambda: pm.plot.deformed(
        [[0.0], [1.0]], [[0, 1]], [[0.0], [1e308]], scale=2.0
    ),
    "must be a regular array": lambda: picture([[1.0, 2.0], [3.0]]),
    "dofs of 'subdomain 0' must lie in 0..0, got 1180591620717411303424": lambda: picture(
        [2**70, 1]
    ),
    "constraints must be a regular array": lambda: (
        coupled().run(steps=1).plot(constraints=[[0, 1], [0]])
    ),
    "scale must not exceed": lambda: pm.plot.deformed(
        [[0.0], [1.0]], [[0, 1]], [[0.0], [0.0]], scale=1e308
    ),
    "value_label must be text, got '\\udcff'": lambda: moving(value_label="\udcff"),
    "interval must": lambda: moving(interval=float("nan")),
    "u of 'subdomain 0' for meshes[0] must have shape": lambda: moving(BLOCK),
    "meshes[0] must have a function of u of 'subdomain 0'": lambda: moving(
        (BLOCK, pm.reduce(np.eye(8), np.eye(8), fixed=[0]).expand)
    ),
}
TYPES_OF_PICTURES = {
    "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got Fraction(0, 1)": lambda: (
        picture([Fraction(0), 0])
    ),
    "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got None": lambda: picture([None]),
    "dofs of 'subdomain 0' must be a 1-D array of whole numbers, got <DIA": lambda: picture(
        sp.dia_array(np.eye(3))
    ),
    "history must be a History or the motion of a mesh, got None": lambda: pm.plot.animation(
        None, {}
    ),
    "values must be callable or the name of a stress, got 1.5": lambda: moving(values=1.5),
    "value_label must be a str, got b'x'": lambda: moving(value_label=b"x"),
    "meshes[0] must be a Structure or (points, elements)": lambda: moving(1.5),
    "points of meshes[0] must": lambda: moving((BLOCK, [None])),
}
OF_PICTURES = pytest.mark.skipif(not find_spec("matplotlib"), reason="needs matplotlib")
REFUSED = [
    *((ValueError, *x) for x in VALUES.items()),
    *((TypeError, *x) for x in TYPES.items()),
    *(pytest.param(ValueError, *x, marks=OF_PICTURES) for x in VALUES_OF_PICTURES.items()),
    *(pytest.param(TypeError, *x, marks=OF_PICTURES) for x in TYPES_OF_PICTURES.items()),
    # of the same words
    (
        ValueError,
        "C must be symmetric",
        lambda: pm.Subdomain(
            MASSES, K, C=np.array([[0, 1, 0], [2**64 - 1, 0, 0], [0, 0, 0]], "u8"), scheme=BETA
        ),
    ),
    (
        ValueError,
        "record must not exceed",
        lambda: pm.analysis.response_spectrum([0.0, -1e308, 1e308], 0.1, [1.0]),
    ),
    (
        ValueError,
        "dt and 1 / dt must not exceed",
        lambda: pm.SupportMotion([0.0, 1.0], 5e-324, "acceleration"),
    ),
    (ValueError, "dt and 1 / dt must not exceed", lambda: pm.cut(BLOCK, [0], dt=0.1).plan(5e-324)),
    pytest.param(
        TypeError,
        "meshes[0] must be a Structure or (points, elements)",
        lambda: moving(([[0.0], [1.0]], [[0, 1]], [[0, 1]])),
        marks=OF_PICTURES,
    ),
]


@pytest.mark.parametrize("error, words, call", REFUSED)
def test_odd_input_is_refused_by_name(error, words, call):
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
    pm.Subdomain(np.array([1e308, 1.0, 1.0]), K, C=C, symmetric=False, scheme=pm.Newmark())


def test_a_step_whose_square_is_zero_raises_no_warning():
    # off the diagonal of M is more than on it: frequencies have no bound by sums of rows
    M = np.array([[1.0, 0.6, 0.6], [0.6, 1.0, 0.6], [0.6, 0.6, 1.0]])
    s = pm.Subdomain(M, K, scheme=pm.CentralDifference())
    pm.Coupler([s], dt=1e-308).step(3)
