"""A structure that is cut and put together again is the uncut one."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from meshes import box
from pairwise import in_turn
from scipy.linalg import eigh
from test_export import read_xdmf

import pmalpha as pm
from pmalpha import structures
from pmalpha.cutting.choice import frequencies
from pmalpha.cutting.division import Division
from pmalpha.cutting.whole import whole_of

SEED = 5


def warped(structure, size, rng):
    """Points moved at random, by a fraction of the element size."""
    return structure.points + size * rng.uniform(-0.2, 0.2, structure.points.shape)


def plate(rng, mass="lumped", nx=6, ny=5):
    regular = structures.plate(nx, ny, 0.5, E=1.0, nu=0.3, rho=1.0)
    count = nx * ny
    values = {x: rng.uniform(0.5, 2.0, count) for x in ("E", "rho", "t")}
    return structures.plate_on(
        warped(regular, 0.5, rng), regular.elements["quad"], nu=0.3, mass=mass, **values
    )


def solid(rng, mass="lumped"):
    regular = structures.solid(3, 3, 2, 0.5, E=1.0, nu=0.3, rho=1.0)
    points = warped(regular, 0.5, rng)
    E = rng.uniform(0.5, 2.0, 18)
    return structures.solid_on(
        points, regular.elements["hexahedron"], E=E, nu=0.2, rho=1.0, mass=mass
    )


TOWER = ([[0, 0], [0, 3], [2, 3], [2, 0], [1, 5]], [[0, 1], [1, 2], [3, 2], [1, 4], [4, 2]])


def frame(rng, mass="lumped"):
    EA = rng.uniform(20.0, 50.0, 5)
    return structures.beam_frame(*TOWER, EA=EA, EI=2.0, rhoA=1.0, divisions=4, mass=mass)


def rod(rng, mass="lumped"):
    return structures.rod(20, 4.0, EA=rng.uniform(1, 2, 20), rhoA=rng.uniform(1, 2, 20), mass=mass)


def chain(rng):
    return structures.chain(20, rng.uniform(1, 2, 20), rng.uniform(1, 2, 19), ground=(3.0, 0.5))


def mixed_plate(rng):
    """Triangles in one half, quadrilaterals in the other."""
    regular = structures.plate(6, 4, 0.5, E=1.0, nu=0.3, rho=1.0)
    quads = regular.elements["quad"]
    triangles = np.vstack([quads[:12, [0, 1, 2]], quads[:12, [0, 2, 3]]])
    elements = {"quad": quads[12:], "triangle": triangles}
    points, E = warped(regular, 0.5, rng), rng.uniform(0.5, 2.0, 36)
    return structures.plate_on(points, elements, E=E, nu=0.3, rho=1.0, mass="lumped")


def regular(kind, n):
    """A box of elements of one kind with edges of 0.5."""
    points, nodes = box(kind, n, 0.5 * n)
    make = structures.plate_on if points.shape[1] == 2 else structures.solid_on
    return make(points, {kind: nodes}, E=1.0, nu=0.3, rho=1.0, mass="lumped")


LINEAR = {
    "triangles and quadrilaterals": mixed_plate,
    "quadrilaterals of second order": lambda rng: regular("quad8", 4),
    "tetrahedra": lambda rng: regular("tetra", 2),
    "tetrahedra of second order": lambda rng: regular("tetra10", 2),
    "plate": plate,
    "plate, consistent": lambda rng: plate(rng, "consistent"),
    "regular plate": lambda rng: structures.plate(6, 5, 0.5, E=1.0, nu=0.3, rho=1.0, mass="lumped"),
    "solid": solid,
    "solid, consistent": lambda rng: solid(rng, "consistent"),
    "frame": frame,
    "frame, consistent": lambda rng: frame(rng, "consistent"),
    "rod": rod,
    "rod, consistent": lambda rng: rod(rng, "consistent"),
    "chain": chain,
}


def rubber(rng):
    sheet = structures.nonlinear_solid(
        4, 3, 0.5, structures.NeoHookean(rng.uniform(1, 2, 12), 0.3), rho=1.0, mass="lumped"
    )
    floor = structures.plane_contact(
        sheet, sheet.nodes_at(y=0.0), point=[0.0, -0.01], normal=[0.0, 1.0], stiffness=3.0
    )
    return sheet.with_internal(floor)


NONLINEAR = {
    "rubber and contact": rubber,
    "block": lambda rng: structures.nonlinear_solid(
        3, 2, 2, 0.5, structures.StVenantKirchhoff(1.0, 0.3), rho=1.0, mass="lumped"
    ),
    "plastic": lambda rng: structures.nonlinear_solid(
        4, 3, 0.5, structures.J2Plasticity(1.0, 0.3, 0.02, 0.1), rho=1.0, mass="lumped"
    ),
    "truss": lambda rng: structures.truss(
        *TOWER, EA=5.0, rhoA=1.0, divisions=3, prestress=0.5, mass="lumped"
    ),
    "turning frame": lambda rng: structures.corotational_frame(
        *TOWER, EA=20.0, EI=2.0, rhoA=1.0, divisions=3
    ),
}


def elements_of(structure):
    return sum(map(len, structure.elements.values()))


def random_labels(count, k, rng):
    """Labels at random, each at least once: disconnected parts, single elements, one in another."""
    return rng.permutation(np.concatenate([np.arange(k), rng.integers(0, k, count - k)]))


def uncut(structure, *, fixed, scheme, force=None, u0=None, v0=None, **options):
    """The structure as one subdomain, and the expansion of its motion."""
    held = pm.reduce(structure.M, structure.K, fixed=fixed)
    internal = [f.reduced(held.free) for f in structure.internal] or None
    own = {name: None if x is None else x[held.free] for name, x in (("u0", u0), ("v0", v0))}
    load = None if force is None else force[held.free]
    one = pm.Subdomain(
        held.M, held.K, scheme=scheme, force=load, internal=internal, **own, **options
    )
    return one, held.expand


def initial(structure, fixed, rng, size=1.0):
    vectors = [size * rng.standard_normal(structure.n) for _ in range(3)]
    for x in vectors[:2]:
        x[fixed] = 0.0
    return dict(zip(("u0", "v0", "force"), vectors))


def compare(parts, one, expand, dt, steps, tolerance=1e-10):
    """Both runs, equal up to `tolerance` times the largest value of each quantity."""
    whole = parts.gather(parts.coupler(dt, coupling="gc").run(steps=steps))
    reference = pm.solve(one, dt=dt, steps=steps)
    for x in "uva":
        expected = expand(getattr(reference, x))
        difference = np.abs(getattr(whole, x) - expected).max()
        assert difference <= tolerance * np.abs(expected).max(), x
    assert np.array_equal(whole.t, reference.t)


# M of the explicit subdomains is not diagonal where it is consistent
@pytest.mark.filterwarnings("ignore::pmalpha.PerformanceWarning")
@pytest.mark.parametrize(
    ("kind", "scheme", "most"),
    [
        (kind, scheme, most)
        for kind, (scheme, most) in in_turn(
            LINEAR, (pm.Newmark(), 25), (pm.CentralDifference(), 2), (pm.CentralDifference(), 25)
        )
    ],
)
def test_put_together_the_motion_is_that_of_the_uncut_structure(kind, scheme, most):
    """To 1e-10 as promised: 15 steps with rounding of 1e-16 and condition numbers of 1e3."""
    rng = np.random.default_rng(SEED)
    structure = LINEAR[kind](rng)
    fixed = structure.dofs(0)
    values = initial(structure, fixed, rng)
    one, expand = uncut(structure, fixed=fixed, scheme=scheme, rayleigh=(0.1, 0.0), **values)
    # a subdomain alone can vibrate faster than the whole, but not faster than its elements
    limit = 2.0 / frequencies(whole_of(structure, fixed, None)).max()
    count = elements_of(structure)
    labels = random_labels(count, min(most, count), rng)
    parts = pm.cut(structure, labels, fixed=fixed, scheme=scheme, rayleigh=(0.1, 0.0), **values)
    assert len(parts.subdomains) == min(most, count)
    compare(parts, one, expand, 0.9 * limit, 15)


@pytest.mark.parametrize(
    ("kind", "scheme"), in_turn(NONLINEAR, pm.GeneralizedAlpha(0.5), pm.CentralDifference())
)
def test_nonlinear_elements_put_together_move_as_the_uncut_structure(kind, scheme):
    """The tolerance of the Newton iteration is 1e-12 of the motion, whose errors add up."""
    rng = np.random.default_rng(SEED)
    structure = NONLINEAR[kind](rng)
    fixed = structure.dofs(0)
    values = initial(structure, fixed, rng, 0.02)
    one, expand = uncut(structure, fixed=fixed, scheme=scheme, **values)
    newton = pm.Newton(tol=1e-12)
    expected = pm.Coupler([one], dt=0.02, newton=newton).run(steps=5)[0]
    count = elements_of(structure)
    parts = pm.cut(structure, random_labels(count, 5, rng), fixed=fixed, scheme=scheme, **values)
    whole = parts.gather(parts.coupler(0.02, coupling="gc", newton=newton).run(steps=5))
    for x in "uv":
        reference = expand(getattr(expected, x))
        assert np.abs(getattr(whole, x) - reference).max() < 1e-8 * np.abs(reference).max()


def dense(A, n):
    if A is None:
        return np.zeros((n, n))
    return np.diag(A) if A.ndim == 1 else sp.csr_array(A).toarray()


@pytest.mark.parametrize("kind", LINEAR)
def test_matrices_and_loads_sum_up_bitwise_identical_where_nothing_is_shared(kind):
    rng = np.random.default_rng(SEED)
    structure = LINEAR[kind](rng)
    count, n = elements_of(structure), structure.n
    labels = random_labels(count, 4, rng)
    force = rng.standard_normal(n)
    parts = pm.cut(structure, labels, force=force, rayleigh=(0.3, 0.02))
    assert np.array_equal(parts.labels, labels)
    total = {x: np.zeros((n, n)) for x in "MKC"}
    load, shared = np.zeros(n), np.zeros((n, n))
    for s, own in zip(parts.subdomains, parts.dofs.values()):
        for x in "MKC":
            total[x][np.ix_(own, own)] += dense(getattr(s, x), s.n)
        load[own] += s.force
        shared[np.ix_(own, own)] += 1.0
    K = structure.K.toarray()
    expected = {"M": structure.M.toarray(), "K": 0.5 * (K + K.T)}
    expected["C"] = 0.3 * expected["M"] + 0.02 * expected["K"]
    for x in "MKC":
        assert np.allclose(total[x], expected[x], rtol=0.0, atol=1e-14 * np.abs(K).max())
    for x in "MK":
        assert np.array_equal(total[x][shared == 1.0], expected[x][shared == 1.0])
    # shares of a load add up to 1 up to rounding
    assert np.allclose(load, force, rtol=1e-15, atol=0.0)
    alone = np.diag(shared) == 1.0
    assert np.array_equal(load[alone], force[alone])


@pytest.mark.parametrize("k", [2, 30])
def test_ties_are_independent_and_leave_the_uncut_motion(k):
    rng = np.random.default_rng(SEED)
    structure = plate(rng)
    fixed = structure.dofs(structure.nodes(lambda x, y: x == x.min()))
    parts = pm.cut(structure, random_labels(30, k, rng), fixed=fixed)
    L = np.hstack([parts.constraints[0].matrices[s].toarray() for s in parts.subdomains])
    copies = sum(own.size for own in parts.dofs.values())
    assert parts.p == len(L) == copies - (structure.n - fixed.size) == np.linalg.matrix_rank(L)
    u = rng.standard_normal(structure.n)
    assert not np.any(L @ np.concatenate(list(parts.scatter(u).values())))


def test_the_load_that_accelerates_a_free_body_uniformly_needs_no_interface_force():
    structure = plate(np.random.default_rng(SEED))
    ones = np.ones(structure.n)
    parts = pm.cut(structure, np.arange(30) % 3, force=structure.M @ ones)
    coupler = parts.coupler(0.01, coupling="gc")
    assert np.abs(coupler.multipliers).max() < 1e-15 * structure.M.max() * 100
    assert np.allclose(coupler.state("part 0").a, 1.0)


def test_loads_of_every_kind_are_divided():
    rng = np.random.default_rng(SEED)
    structure = plate(rng)
    n, t = structure.n, 0.37
    samples = rng.standard_normal((6, 2))
    kinds = [
        pm.SampledForce(samples, 0.1, shape=rng.standard_normal((n, 2))),
        pm.SampledForce(rng.standard_normal((6, n)), 0.1),
        pm.BaseAcceleration(samples, rng.standard_normal((n, 2)), structure.M, dt=0.1),
        lambda t: np.sin(t * np.arange(n)),
    ]
    for force in kinds:
        parts = pm.cut(structure, np.arange(30) % 4, force=force)
        total = np.zeros(n)
        for s, own in zip(parts.subdomains, parts.dofs.values()):
            assert isinstance(s.force, type(force)) or callable(s.force)
            total[own] += s.force(t)
        assert np.allclose(total, force(t), rtol=1e-14, atol=1e-15)
    quake = pm.cut(structure, np.arange(30) % 4, force=kinds[2])
    assert not np.any(quake.subdomains[0].force(5.0))  # zero after its end


def test_the_load_of_a_ground_motion_with_fixed_supports_moves_the_whole():
    rng = np.random.default_rng(SEED)
    structure = frame(rng)
    fixed = structure.dofs([0, 3])
    along = np.zeros(structure.n)
    along[structure.dofs(np.arange(len(structure.points)), "ux")] = 1.0
    quake = pm.BaseAcceleration(rng.standard_normal(30), along, structure.M, dt=0.02)
    parts = pm.cut(structure, np.arange(20) // 4, fixed=fixed, force=quake)
    held = pm.reduce(structure.M, structure.K, fixed=fixed)
    load = pm.BaseAcceleration(quake.values, along[held.free], held.M, dt=0.02)
    one = pm.Subdomain(held.M, held.K, scheme=pm.GeneralizedAlpha(0.5), force=load)
    compare(parts, one, held.expand, 0.02, 15)


def test_initial_values_go_to_both_sides_and_come_back():
    rng = np.random.default_rng(SEED)
    structure = solid(rng)
    values = initial(structure, structure.dofs(0), rng)
    parts = pm.cut(structure, np.arange(18) % 5, fixed=structure.dofs(0), **values)
    back = parts.gather(parts.coupler(0.01, coupling="pm").run(steps=0))
    # the mean of equal values with shares that sum up to 1 up to rounding
    assert np.allclose(back.u[0], values["u0"], rtol=1e-15, atol=0.0)
    assert np.allclose(back.v[0], values["v0"], rtol=1e-15, atol=0.0)
    assert back.dofs.tolist() == list(range(structure.n))


def test_elements_of_several_kinds_make_one_structure():
    """Hexahedra given by their matrices with rods on them, some dofs fixed by negative numbers."""
    rng = np.random.default_rng(SEED)
    box = structures.solid(2, 2, 2, 0.5, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    one = structures.solid(1, 1, 1, 0.5, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    nodes = box.elements["hexahedron"]
    where = one.elements["hexahedron"][0]
    own = (3 * where[:, None] + np.arange(3)).ravel()
    K = one.K.toarray()[np.ix_(own, own)]
    M = one.M.diagonal()[own]
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(8, 24)
    spring = np.array([[2.0, -2.0], [-2.0, 2.0]])
    rods = pm.Elements([[0, 80], [-1, 40], [3, 60]], None, [spring])
    groups = [pm.Elements(dofs, [M], [K]), rods]
    whole_K = box.K.toarray()
    for a, b in ((0, 80), (None, 40), (3, 60)):
        pair = [x for x in (a, b) if x is not None]
        whole_K[np.ix_(pair, pair)] += spring[: len(pair), : len(pair)]
    v0 = rng.standard_normal(box.n)
    reference = pm.Subdomain(box.M, whole_K, scheme=pm.CentralDifference(), v0=v0)
    labels = np.array([0, 1, 2, 0, 1, 2, 3, 3, 0, 1, 2])
    labels[8:] = [labels[i] for i in (0, 3, 0)]  # massless rods beside elements with mass
    massive = [
        any(d in dofs[labels[:8] == labels[8 + r]] for d in own if d >= 0)
        for r, own in enumerate(rods.dofs)
    ]
    assert all(massive)
    parts = pm.cut(groups, np.zeros(11, dtype=int), v0=v0, scheme=pm.CentralDifference())
    compare(parts, reference, lambda u: u, 0.1, 30)
    parts = pm.cut(groups, labels, v0=v0, scheme=pm.GeneralizedAlpha(0.5))
    implicit = pm.Subdomain(box.M, whole_K, scheme=pm.GeneralizedAlpha(0.5), v0=v0)
    # the far ends of the rods have no mass in some subdomains
    compare(parts, implicit, lambda u: u, 0.1, 30)


def hardening(t, u, v, q, elements):
    """Elements of two dofs with a cubic force, a dashpot, and a counter of steps as history."""
    e = u[:, 1] - u[:, 0]
    f = (3.0 + elements) * e**3 + 0.1 * (v[:, 1] - v[:, 0])
    sign = np.array([-1.0, 1.0])
    pairs = sign[:, None] * sign
    K = (3.0 * (3.0 + elements) * e**2)[:, None, None] * pairs
    return f[:, None] * sign, K, np.broadcast_to(0.1 * pairs, K.shape), q + 1.0


@pytest.mark.gate
def test_elements_with_internal_forces_dampers_and_history():
    rng = np.random.default_rng(SEED)
    dofs = np.column_stack([np.arange(-1, 11), np.arange(12)])
    k = 4.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    group = pm.Elements(
        dofs, [[0.5, 0.5]], [k], C=[0.05 * k], internal=hardening, history=np.zeros((12, 1))
    )
    v0 = rng.standard_normal(12)
    newton = pm.Newton(tol=1e-12)
    one = pm.cut(group, np.zeros(12, dtype=int), v0=v0)
    reference = one.gather(one.coupler(0.05, newton=newton, coupling="pm").run(steps=10))
    for labels in (np.arange(12) // 5, np.arange(12) % 3):
        parts = pm.cut(group, labels, v0=v0)
        run = parts.coupler(0.05, coupling="gc", newton=newton).run(steps=10)
        assert np.abs(parts.gather(run).u - reference.u).max() < 1e-9
        assert np.all(np.diff(run[0].q[:, 0]) == 1.0) and run[0].q.shape == (11, sum(labels == 0))
    # an independent uncut model: K u, the cubic springs and the dashpots in one callable
    B = np.eye(12) - np.eye(12, k=-1)

    def whole(t, u, v, q):
        e, rate = B @ u, B @ v
        stiff = 3.0 + np.arange(12)
        K = B.T @ np.diag(3.0 * stiff * e**2) @ B
        return B.T @ (stiff * e**3 + 0.1 * rate), K, 0.1 * B.T @ B

    masses = np.append(np.ones(11), 0.5)
    alone = pm.Subdomain(
        masses,
        4.0 * B.T @ B,
        C=0.2 * B.T @ B,
        scheme=pm.GeneralizedAlpha(0.5),
        internal=whole,
        v0=v0,
    )
    expected = pm.Coupler([alone], dt=0.05, newton=newton).run(steps=10)[0]
    assert np.abs(expected.u - reference.u).max() < 1e-9


def test_parts_of_equal_cost_are_balanced_with_small_interfaces():
    pytest.importorskip("pymetis")
    structure = structures.plate(40, 40, 1.0, E=1.0, nu=0.3, rho=1.0)
    parts = pm.cut(structure, parts=4)
    sizes = np.bincount(parts.labels)
    assert sizes.max() < 1.05 * sizes.mean()  # METIS allows 3 %
    # two straight cuts have 81 nodes; METIS may need up to half as many more
    assert parts.p < 1.5 * 2 * 82


def test_without_metis_coordinates_are_bisected(monkeypatch):
    monkeypatch.setattr("pmalpha.cutting.choice.has_nested_dissection", lambda: False)
    structure = structures.plate(12, 4, 1.0, E=1.0, nu=0.3, rho=1.0)
    parts = pm.cut(structure, parts=3)
    assert np.bincount(parts.labels).tolist() == [16, 16, 16]
    assert parts.p == 2 * 2 * 5  # two straight cuts of five nodes with two dofs
    group = pm.Elements([[0, 1], [1, 2], [2, 3]], [[0.5, 0.5]], [[[1.0, -1.0], [-1.0, 1.0]]])
    with pytest.raises(ValueError, match="points, the centres of the elements, must be given"):
        pm.cut(group, parts=2)
    assert pm.cut(group, parts=2, points=[[0.0], [1.0], [2.0]]).labels.tolist() == [0, 1, 1]
    assert len(pm.cut(structure, parts=48).subdomains) == 48  # single elements


@pytest.mark.parametrize(
    ("labels", "names"), [(["b", "a"], ["a", "b"]), ([11, 7], ["part 7", "part 11"])]
)
def test_names_are_labels_or_tags_of_a_mesh_and_schemes_can_differ(labels, names):
    structure = structures.rod(4, 4.0, EA=1.0, rhoA=1.0)
    schemes = dict(zip(labels, (pm.Newmark(), pm.GeneralizedAlpha(0.8))))
    parts = pm.cut(structure, np.repeat(labels, 2).tolist(), scheme=schemes)
    assert [s.name for s in parts.subdomains] == names
    assert [s.scheme for s in parts.subdomains] == [schemes[x] for x in labels[::-1]]
    assert parts.labels.tolist() == [1, 1, 0, 0]
    assert list(parts.dofs[names[0]]) == [2, 3, 4]
    assert parts.scatter(np.arange(5.0))[names[1]].tolist() == [0.0, 1.0, 2.0]


def test_a_layer_is_the_elements_around_nodes():
    block = structures.plate(4, 5, 0.5, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    low = block.nodes_at(y=0.0)
    rows = np.round((block.points[block.elements["quad"]].mean(axis=1)[:, 1] - 0.25) / 0.5)
    mask = np.zeros(len(block.points), dtype=bool)
    mask[low] = True
    for given, depth in [(low, 1), (mask, 1), ((low, 1), 1), ((low.tolist(), 3), 3)]:
        parts = pm.cut(block, layer_of=given)
        assert [s.name for s in parts.subdomains] == ["bulk", "layer"]
        assert [s.scheme.explicit for s in parts.subdomains] == [False, True]
        assert np.array_equal(parts.labels, rows < depth)
        assert not np.isin(block.dofs(low), parts.dofs["bulk"]).any()
    assert pm.cut(block, layer_of=(low[0], 2)).labels.sum() == 4
    named = replace(block, sets={"foot": low})
    assert np.array_equal(pm.cut(named, layer_of="foot").labels, rows < 1)


def test_substeps_of_the_user_take_the_place_of_those_of_dt():
    rod = structures.rod(4, 4.0, EA=[1.0, 1.0, 4.0, 4.0], rhoA=1.0, mass="lumped")
    scheme = {3: pm.Newmark(), 7: pm.CentralDifference()}
    parts = pm.cut(rod, [3, 3, 7, 7], dt=0.9, scheme=scheme, substeps={3: 5})
    assert [(s.name, s.substeps) for s in parts.subdomains] == [("part 3", 5), ("part 7", 2)]
    one = pm.cut(rod, layer_of=0, dt=0.9, substeps={"bulk": 4, "layer": 3})
    assert [s.substeps for s in one.subdomains] == [4, 3]
    for value, error in (({"soil": 2}, KeyError), ({3: 0}, ValueError), (2, TypeError)):
        with pytest.raises(error, match="substeps"):
            pm.cut(rod, [3, 3, 7, 7], dt=0.9, scheme=scheme, substeps=value)
    with pytest.raises(TypeError, match="auto"):
        pm.cut(rod, parts="auto", dt=0.9, substeps={"implicit": 2})


def test_a_layer_has_the_finest_step_whatever_the_schemes_are():
    rod = structures.rod(6, 6.0, EA=[1.0, 1.0, 1.0, 1.0, 1.0, 16.0], rhoA=1.0, mass="lumped")
    one = pm.cut(rod, layer_of=0, dt=0.9)
    assert [s.substeps for s in one.subdomains] == [1, 2]
    # the bulk has the stiffest element
    both = pm.cut(rod, layer_of=(0, 2), dt=0.9, scheme=pm.CentralDifference(), u0=np.ones(7))
    assert [s.substeps for s in both.subdomains] == [4, 4]
    other = {"layer": pm.CentralDifference(), "bulk": pm.Newmark()}
    parts = pm.cut(rod, layer_of=0, dt=0.9, scheme=other)
    assert [(s.scheme, s.substeps) for s in parts.subdomains] == [
        (pm.Newmark(), 1),
        (pm.CentralDifference(), 1),
    ]


def test_contact_at_a_layer_is_subcycled_and_never_gains_energy():
    block = structures.plate(4, 5, 0.5, E=100.0, nu=0.3, rho=1.0, mass="lumped")
    low = block.nodes_at(y=0.0)
    v0 = np.zeros(block.n)
    v0[block.dofs(np.arange(len(block.points)), "uy")] = -1.0
    parts = pm.cut(block, layer_of=low, dt=0.1, v0=v0)
    bulk, layer = parts.subdomains
    assert layer.substeps == 4 and bulk.substeps == 1
    floor = pm.contact(layer, [f"uy {node}" for node in low], gap=0.1)
    coupler = pm.Coupler([bulk, layer], [*parts.constraints, floor], dt=0.1, coupling="gc")
    history = coupler.run(4.0, energy=True)
    assert history.contacts[floor].closed.any(axis=0).all()
    energy = history.energy.kinetic.sum(axis=1) + history.energy.strain.sum(axis=1)
    assert energy.max() == energy[0]
    last = parts.gather(history).v[-1]
    assert block.M @ last @ np.tile([0.0, 1.0], last.size // 2) > 0.0  # it flies back


@pytest.mark.parametrize(
    "labels",
    [[7, 3, 3, 11], np.array([0, -2, -2, 10**12]), np.array([2, 1, 1, 250], dtype=np.uint8)],
)
def test_labels_are_any_whole_numbers_such_as_the_tags_of_a_mesh(labels):
    rod = structures.rod(4, 4.0, EA=1.0, rhoA=1.0)
    parts = pm.cut(rod, labels)
    tags = sorted(set(np.asarray(labels).tolist()))
    assert [s.name for s in parts.subdomains] == [f"part {tag}" for tag in tags]
    assert parts.labels.tolist() == [tags.index(tag) for tag in np.asarray(labels).tolist()]
    by_name = pm.cut(rod, ["b", "a", "a", "c"])
    for one, other in zip(parts.subdomains, by_name.subdomains):
        assert (one.K != other.K).nnz == 0
    assert parts.plan(dt=0.1).entries == by_name.plan(dt=0.1).entries


def test_a_gathered_history_is_that_of_macro_times_with_every_and_substeps():
    structure = structures.rod(6, 3.0, EA=[1.0] * 3 + [16.0] * 3, rhoA=1.0, mass="lumped")
    parts = pm.cut(
        structure, np.repeat([0, 1], 3), dt=0.4, scheme=pm.CentralDifference(), v0=np.ones(7)
    )
    assert [s.substeps for s in parts.subdomains] == [1, 4]
    for every in (None, 2):
        run = parts.coupler(coupling="gc").run(steps=4, every=every)
        whole = parts.gather(run)
        assert np.array_equal(whole.t, run.macro_times)
        # a body that moves as a whole
        assert np.allclose(whole.u, whole.t[:, None] * np.ones(7), atol=1e-13)


def test_a_run_in_a_file_is_gathered_as_one_in_memory(tmp_path):
    pytest.importorskip("h5py")
    rng = np.random.default_rng(SEED)
    structure = plate(rng)
    parts = pm.cut(structure, np.arange(30) % 3, v0=rng.standard_normal(structure.n))
    run = parts.coupler(0.05, coupling="pm").run(steps=5, record_to=tmp_path / "run.h5")
    again = parts.coupler(0.05, coupling="pm").run(steps=5)
    assert np.array_equal(parts.gather(run).u, parts.gather(again).u)


# ---- critical steps --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*LINEAR, *NONLINEAR])
def test_no_assembly_vibrates_faster_than_the_bound_of_its_elements(kind):
    rng = np.random.default_rng(SEED)
    structure = (LINEAR | NONLINEAR)[kind](rng)
    bounds = frequencies(whole_of(structure, None, None))
    highest = np.sqrt(eigh(structure.tangent().toarray(), structure.M.toarray())[0][-1])
    contact = 1.0 + 1e-12 if "contact" not in kind else np.inf  # contact belongs to no element
    assert highest <= bounds.max() * contact
    assert bounds.shape == (elements_of(structure),)


@pytest.mark.gate
def test_the_bound_of_an_element_is_close_to_its_highest_frequency():
    rng = np.random.default_rng(SEED)
    for structure in (solid(rng), solid(rng, "consistent"), frame(rng), plate(rng)):
        whole = whole_of(structure, structure.dofs(0), None)
        bounds = frequencies(whole)
        kind, nodes = next(iter(structure.elements.items()))
        for e in range(0, elements_of(structure), 4):
            parts = pm.cut(
                structure, np.where(np.arange(len(bounds)) == e, 1, 0), fixed=structure.dofs(0)
            )
            s = parts.subdomains[1]
            exact = np.sqrt(eigh(dense(s.K, s.n), dense(s.M, s.n))[0][-1])
            size = nodes.shape[1] * structure.dofs_per_node
            assert exact <= bounds[e] * (1 + 1e-12)
            assert bounds[e] <= exact * size ** (1 / 32) * (1 + 1e-12)


def graded_plate(ratio=300.0, n=24):
    """A square with elements that become finer towards the lower left corner."""
    edges = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, ratio, n))]) / ratio
    X, Y = np.meshgrid(edges, edges, indexing="ij")
    regular = structures.plate(n, n, 1.0, E=1.0, nu=0.3, rho=1.0)
    points = np.column_stack([X.ravel(), Y.ravel()])
    return structures.plate_on(
        points, regular.elements["quad"], E=1.0, nu=0.3, rho=1.0, mass="lumped"
    )


def neighbours(structure):
    """Pairs of elements with a common node."""
    (nodes,) = structure.elements.values()
    member = sp.csr_array(
        (np.ones(nodes.size), (np.repeat(np.arange(len(nodes)), nodes.shape[1]), nodes.ravel()))
    )
    return sp.coo_array(member @ member.T).coords


def test_levels_suffice_for_each_element_and_are_graded():
    structure = graded_plate()
    bounds = frequencies(whole_of(structure, None, None))
    scheme = pm.GeneralizedAlpha(0.5, explicit=True)
    limit = 1.5 * np.sqrt(12 * 1.5 / (1.5 * (10 - 2.5 + 0.25)))  # METHOD: Omega_s at rho = 0.5
    dt = 0.95 * limit / bounds.min()
    parts = pm.cut(structure, "steps", dt=dt)
    substeps = np.array([s.substeps for s in parts.subdomains])
    assert np.array_equal(substeps[1:], 2 * substeps[:-1]) and len(substeps) > 5
    own = substeps[parts.labels]
    Omega = pm.cutting.choice.critical_product(scheme)
    assert np.all(dt / own * bounds <= 0.95 * Omega * (1 + 1e-9))
    i, j = neighbours(structure)
    assert np.max(own[i] / own[j]) <= 4
    # not one finer than needed, apart from grading and islands
    needed = 2 ** np.ceil(np.maximum(np.log2(dt * bounds / (0.95 * Omega)), 0.0) - 1e-9)
    assert np.mean(own == needed) > 0.95


def test_neighbours_of_a_much_smaller_element_are_graded_by_a_factor_of_four():
    rod = structures.rod(
        60, 60.0, EA=np.where(np.arange(60) == 30, 4.0**6, 1.0), rhoA=1.0, mass="lumped"
    )
    parts = pm.cut(rod, "steps", dt=0.8)
    own = np.array([s.substeps for s in parts.subdomains])[parts.labels]
    ratio = own[1:] / own[:-1]
    assert own[30] == 64 and own[0] == own[-1] == 1
    assert ratio.max() <= 4 and ratio.min() >= 0.25


def test_an_island_of_a_few_coarse_elements_is_absorbed_and_a_fine_one_is_not():
    EA = np.full(60, 4.0)
    EA[10:14], EA[30:50] = 1.0, 1.0  # 4 and 20 elements that need half as many substeps
    rod = structures.rod(60, 60.0, EA=EA, rhoA=1.0, mass="lumped")
    parts = pm.cut(rod, "steps", dt=0.8)
    own = np.array([s.substeps for s in parts.subdomains])[parts.labels]
    assert np.all(own[10:14] == 2) and np.all(own[30:50] == 1)
    EA = np.ones(60)
    EA[20] = 4.0
    parts = pm.cut(structures.rod(60, 60.0, EA=EA, rhoA=1.0, mass="lumped"), "steps", dt=0.8)
    assert np.array([s.substeps for s in parts.subdomains])[parts.labels][20] == 2


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_a_graded_mesh_is_stable_at_most_of_the_limit_of_each_level(coupling):
    """A body with random velocities, 400 macro steps: the energy does not grow."""
    rng = np.random.default_rng(SEED)
    structure = graded_plate(40.0, 16)
    fixed = structure.dofs(structure.nodes(lambda x, y: x == 0.0))
    v0 = rng.standard_normal(structure.n)
    v0[fixed] = 0.0
    bounds = frequencies(whole_of(structure, fixed, None))
    scheme = pm.GeneralizedAlpha(0.8, explicit=True)
    dt = 0.95 * pm.cutting.choice.critical_product(scheme) / bounds.min()
    parts = pm.cut(structure, "steps", dt=dt, scheme=scheme, v0=v0, fixed=fixed)
    assert len(parts.subdomains) > 4
    run = parts.coupler(coupling=coupling).run(steps=400, every=20)
    v = parts.gather(run).v
    energy = 0.5 * np.einsum("kn,n,kn->k", v, structure.M.diagonal(), v)
    assert np.all(energy[1:] <= 1.01 * energy[0])  # that at t = 0 is kinetic


def smooth_wave(structure):
    x, y = structure.points.T
    u0 = np.zeros(structure.n)
    u0[::2] = np.exp(-20.0 * ((x - 0.5 * x.max()) ** 2 + (y - 0.5 * y.max()) ** 2) / x.max() ** 2)
    return u0


@pytest.mark.parametrize(("coupling", "order"), [("macro", 2.0), ("gc", 1.0)])
def test_a_subcycled_run_has_the_order_of_its_coupling(coupling, order):
    """Against the uncut structure with steps of an eighth of the finest; gc is of order 1 at least,
    observed between 1 and 2."""
    structure = graded_plate(12.0, 8)
    u0 = smooth_wave(structure)
    one = pm.Subdomain(structure.M, structure.K, scheme=pm.Newmark(), u0=u0)
    bounds = frequencies(whole_of(structure, None, None))
    scheme = pm.CentralDifference()
    dt = 0.95 * 2.0 / bounds.min()
    parts = pm.cut(structure, "steps", dt=dt, scheme=scheme, u0=u0)
    assert len(parts.subdomains) > 2
    omega, shapes = eigh(structure.K.toarray(), structure.M.toarray())
    q = shapes.T @ (structure.M @ u0)
    exact = shapes @ (q * np.cos(np.sqrt(np.abs(omega)) * 8 * dt))
    assert one.n == structure.n
    errors = []
    for halvings in (2, 4, 8):
        run = parts.coupler(dt / halvings, coupling=coupling).run(steps=8 * halvings)
        errors.append(np.abs(parts.gather(run).u[-1] - exact).max())
    observed = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(observed > order - 0.25), (errors, observed)


# ---- pictures and files ------------------------------------------------------------------------


def test_a_picture_has_each_subdomain_in_its_colour():
    pytest.importorskip("matplotlib")
    parts = pm.cut(graded_plate(40.0, 8), "steps", dt=0.5)
    ax = parts.plot()
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == [s.name for s in parts.subdomains]
    colours = {tuple(c.get_facecolor().ravel()) for c in ax.collections if c.get_facecolor().size}
    assert len(colours) >= len(names)
    group = pm.Elements([[0, 1]], [[0.5, 0.5]], [[[1.0, -1.0], [-1.0, 1.0]]])
    with pytest.raises(ValueError, match="plot needs a Structure with a mesh"):
        pm.cut(group, [0]).plot()


@pytest.mark.parametrize("name", ["run.xdmf", "run.pvd"])
def test_a_file_has_the_subdomains_of_the_elements(tmp_path, name):
    structure = graded_plate(40.0, 6)
    parts = pm.cut(structure, "steps", dt=0.5, u0=smooth_wave(structure))
    run = parts.coupler(coupling="gc").run(steps=3)
    parts.export(tmp_path / name, run)
    if name == "run.pvd":
        mesh = pytest.importorskip("meshio").read(tmp_path / "run" / "000002.vtu")
        numbers = {key: values[0] for key, values in mesh.cell_data.items()}
        u = mesh.point_data["displacement"]
    else:
        _, _, _, fields = list(read_xdmf(tmp_path / name))[2]
        numbers = {key: fields[key, "Scalar", "Cell"] for key in ("part", "substeps")}
        u = fields["displacement", "Vector", "Node"]
    assert np.array_equal(numbers["part"], parts.labels)
    substeps = [parts.subdomains[i].substeps for i in parts.labels]
    assert np.array_equal(numbers["substeps"], substeps)
    assert np.array_equal(u[:, :2].ravel(), parts.gather(run).u[2])


# ---- errors ------------------------------------------------------------------------------------

K2 = [[[1.0, -1.0], [-1.0, 1.0]]]
CHAIN = structures.chain(4, 1.0, 1.0)
BARE = pm.Elements([[0, 1]], [[1.0, 1.0]], K2)
STEPS = {"labels": "steps", "dt": 0.1}


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"labels": [0, 1]}, ValueError, r"labels must have shape \(3,\)"),
        ({"labels": [0.0, 1.0, 1.0]}, TypeError, "labels must be whole numbers or names"),
        ({"labels": "step"}, ValueError, "labels must be an array or \"steps\", got 'step'"),
        ({"labels": "steps"}, TypeError, 'dt must be given with labels="steps"'),
        (STEPS | {"parts": 2}, TypeError, "parts must not be given"),
        (STEPS | {"scheme": pm.Newmark()}, ValueError, "scheme must be one explicit"),
        (STEPS | {"dt": 1e9}, ValueError, r"dt must be at most 2\^20 times the critical"),
        ({}, TypeError, "labels or parts must be given"),
        ({"labels": [0, 0, 1], "parts": 2}, TypeError, "must be given, and not both"),
        ({"parts": 0}, ValueError, "parts must be at least 1, got 0"),
        ({"parts": 4}, ValueError, "parts must be at most the number of elements, 3, got 4"),
        ({"parts": 2.0}, TypeError, "parts must be a whole number"),
        ({"parts": "best"}, ValueError, "parts must be a number or \"auto\", got 'best'"),
        ({"parts": "auto"}, TypeError, 'dt must be given with parts="auto"'),
        (STEPS | {"parts": "auto", "labels": [0, 0, 1]}, TypeError, "labels must not be given"),
        (
            {"parts": "auto", "dt": 0.1, "scheme": pm.Newmark()},
            ValueError,
            "scheme must be an explicit and an implicit one",
        ),
        ({"structure": "plate", "labels": [0]}, TypeError, "must be a Structure, pm.Elements"),
        ({"structure": [], "labels": [0]}, ValueError, "structure must have elements"),
        ({"layer_of": 0, "labels": [0, 0, 1]}, TypeError, "must not be given with layer_of"),
        ({"layer_of": 0, "parts": "auto"}, TypeError, "labels and parts must not be given with"),
        ({"layer_of": 4}, ValueError, r"layer_of must lie in 0..3, got 4"),
        ({"layer_of": [0.0]}, TypeError, "layer_of must be a 1-D array of whole numbers"),
        ({"layer_of": []}, ValueError, "layer_of must have a node, got none"),
        ({"layer_of": "foot"}, ValueError, "layer_of must be a set of nodes, of none, got 'foot'"),
        ({"layer_of": (0, 0)}, ValueError, "depth of layer_of must be at least 1, got 0"),
        ({"layer_of": (0, 1.5)}, TypeError, "depth of layer_of must be a whole number"),
        ({"layer_of": (0, 10**9)}, ValueError, "must leave elements for the bulk, got all 3 up to"),
        ({"structure": BARE, "layer_of": 0}, TypeError, "must be nodes of a Structure"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        pm.cut(**{"structure": CHAIN} | arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"dt": -1.0}, ValueError, "dt must be positive"),
        ({"scheme": "explicit"}, ValueError, "scheme must be one or one for each"),
        ({"scheme": [pm.Newmark()]}, ValueError, "scheme must be one or one for each"),
        ({"scheme": {"a": pm.Newmark()}}, ValueError, "scheme must have one for each"),
        ({"scheme": 3}, TypeError, "scheme must be a Scheme, got 3"),
        ({"force": [1.0]}, ValueError, r"force must have shape \(4,\)"),
        ({"u0": [1.0]}, ValueError, r"u0 must have shape \(4,\)"),
        ({"fixed": [0], "v0": [1.0, 0, 0, 0]}, ValueError, "v0 must be zero at fixed dofs"),
        ({"fixed": [4]}, ValueError, r"fixed must lie in 0..3, got 4"),
        ({"fixed": [0, 1, 2, 3]}, ValueError, "fixed must leave a dof free"),
        ({"fixed": [2, 3]}, ValueError, "labels must leave 'part 1' a free dof"),
        ({"points": [[0.0]] * 3}, TypeError, "points must not be given"),
        ({"rayleigh": 0.1}, TypeError, "rayleigh must be a pair"),
    ],
)
def test_bad_arguments_with_labels_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        pm.cut(CHAIN, [0, 0, 1], **arguments)


def test_fixed_elements_with_internal_forces_are_refused_by_name():
    def cubic(t, u, v, q, elements):
        return u**3, 3.0 * u[:, :, None] ** 2

    springs = pm.Elements([[0], [1]], [[1.0]], None, internal=cubic)
    with pytest.raises(ValueError, match="labels must leave 'part 0' a free dof"):
        pm.cut(springs, [0, 1], fixed=[0])


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"dofs": [0, 1]}, ValueError, r"dofs must have shape \(elements, dofs of one\)"),
        ({"dofs": [[0.0, 1.0]]}, TypeError, "dofs must hold whole numbers"),
        ({"dofs": [[-1, -1]]}, ValueError, "dofs must not all be fixed"),
        ({"M": [[1.0]]}, ValueError, r"M must have shape \(1, 2\) or \(1, 2, 2\)"),
        ({"M": [[1.0, -1.0]]}, ValueError, "M must not be negative, got -1 in 1 element, 0"),
        ({"M": [[1.0, np.nan]]}, ValueError, "M must be finite, not in element 0"),
        ({"K": [[[1.0, -1.0], [0.0, 1.0]]]}, ValueError, "K must be symmetric"),
        ({"K": [[1.0, -1.0], [-1.0, 1.0]]}, ValueError, r"K must have shape \(1, 2, 2\)"),
        ({"K": None}, TypeError, "K must not be None without internal forces"),
        ({"C": [["a"]]}, TypeError, "C must hold real numbers"),
        ({"history": [[0.0]]}, TypeError, "history must come with internal forces"),
        ({"internal": 3}, TypeError, "internal must be callable"),
        ({"internal": abs, "history": [[0.0]] * 2}, ValueError, "history must have 1 row, got 2"),
    ],
)
def test_bad_elements_are_refused_by_name(change, error, message):
    with pytest.raises(error, match=message):
        pm.Elements(**{"dofs": [[0, 1]], "M": [[0.5, 0.5]], "K": K2} | change)


UNKNOWN = structures.Structure(
    np.ones(2), sp.csr_array(np.eye(2)), np.zeros((2, 1)), {"line": np.array([[0, 1]])}, ("ux",)
)
WITHOUT = pm.Elements([[0, 1], [1, 2]], [[0.5, 0.5], [0.0, 0.0]], K2)
BARS = [structures.truss([[0, 0], [1, 0]], [[0, 1]], EA=EA, rhoA=1.0) for EA in (1.0, 2.0)]


@pytest.mark.parametrize(
    ("structure", "labels", "options", "error", "message"),
    [
        (UNKNOWN, [0], {}, ValueError, "structure must know the matrices of its elements"),
        (
            pm.Elements([[0, 1], [1, 3]], [[0.5, 0.5]], K2),
            [0, 1],
            {},
            ValueError,
            "structure must have an element at every dof in 0..3, not at dof 2",
        ),
        (
            WITHOUT,
            [0, 1],
            {"scheme": pm.CentralDifference()},
            pm.FactorizationError,
            "'part 1' is explicit and none of its elements has mass at 2 dofs of the uncut",
        ),
        (WITHOUT, "steps", {"dt": 0.1}, ValueError, "have no mass where they have stiffness"),
        (
            BARS[1].with_internal(*BARS[0].internal),
            [0],
            {},
            TypeError,
            "internal forces of its elements and contact only",
        ),
        (WITHOUT, [0, 0], {"points": [[0.0]]}, ValueError, "a row for each of 2 elements, got 1"),
    ],
)
def test_what_cannot_be_cut_is_refused(structure, labels, options, error, message):
    with pytest.raises(error, match=message):
        pm.cut(structure, labels, **options)


def test_what_cannot_be_gathered_is_refused():
    parts = pm.cut(CHAIN, [0, 0, 1])
    coupler = parts.coupler(0.1, coupling="pm")
    with pytest.raises(TypeError, match="history must be a History"):
        parts.gather(np.zeros(3))
    for record, message in (
        ({"part 0": [0], "part 1": None}, "history must have all 3 dofs of 'part 0', got 1"),
        ({"part 0": None}, "history must have a subdomain 'part 1'"),
    ):
        with pytest.raises(ValueError, match=message):
            parts.gather(coupler.run(steps=1, record=record))
    for call in (parts.coupler, parts.plan):
        with pytest.raises(TypeError, match="dt must be given here or to cut"):
            call()
    with pytest.raises(ValueError, match="u must have the 4 dofs of the uncut structure"):
        parts.scatter(np.zeros(3))


def test_shares_without_weights_are_equal():
    division = Division(2, [np.array([0, 1]), np.array([1])], [np.zeros(2), np.zeros(1)])
    assert [x.tolist() for x in division.shares] == [[1.0, 0.5], [0.5]]


# ---- plans -------------------------------------------------------------------------------------


PLANNED = {
    "levels": lambda: pm.cut(graded_plate(40.0, 12), "steps", dt=0.5),
    "implicit parts": lambda: pm.cut(
        structures.plate(20, 20, 0.1, E=1.0, nu=0.3, rho=1.0), parts=4
    ),
    "solids": lambda: pm.cut(
        structures.solid(6, 6, 6, 0.1, E=1.0, nu=0.3, rho=1.0, mass="lumped"),
        parts=5,
        scheme=pm.CentralDifference(),
    ),
    "mixed": lambda: pm.cut(
        structures.plate(20, 20, 0.1, E=1.0, nu=0.3, rho=1.0, mass="lumped"),
        np.arange(400) // 200,
        scheme=[pm.Newmark(), pm.CentralDifference()],
        rayleigh=(0.1, 0.0),
    ),
}


@pytest.mark.parametrize("kind", PLANNED)
def test_a_plan_predicts_the_steps_and_the_entries_that_the_core_reads(kind):
    parts = PLANNED[kind]()
    dt = parts.dt or 0.01
    plan = parts.plan(dt)
    coupler = parts.coupler(dt, coupling="gc")
    run = coupler.run(steps=3)
    for row, part in zip(plan.subdomains, coupler._session.members):
        assert len(run[row.name].t) - 1 == 3 * row.substeps
        assert (row.name, row.dofs, row.interface) == (part.name, part.n, part.nb)
        # the core stores K in strips, node by node, with some zeros: up to a fifth in plates
        assert 0.8 * part.core.entries <= row.entries <= part.core.entries
    assert plan.constraints == parts.p
    assert len(run.multiplier_times) - 1 == 3 * plan.fine_steps
    own = sum(row.substeps * row.entries for row in plan.subdomains)
    assert plan.entries == own + plan.fine_steps * plan.interface
    assert plan.stable and plan.gain == plan.uncut_cost / plan.cost


def test_the_entries_of_the_uncut_run_are_those_that_its_core_reads():
    for scheme in (pm.CentralDifference(), pm.Newmark()):
        structure = structures.plate(30, 30, 0.1, E=1.0, nu=0.3, rho=1.0, mass="lumped")
        plan = pm.cut(structure, parts=3, scheme=scheme).plan(1e-3)
        coupler = pm.Coupler([structure.subdomain(scheme=scheme)], dt=1e-3)
        entries = coupler._session.members[0].core.entries
        # zeros of strips, as above; fill of the factor in another order
        assert 0.8 * entries <= plan.uncut <= 1.05 * entries


def test_a_plan_of_a_longer_macro_step_is_not_stable():
    parts = pm.cut(graded_plate(40.0, 8), "steps", dt=0.5)
    assert parts.plan().stable and not parts.plan(2.0).stable
    assert "gain" in repr(parts) and "gain" in repr(parts.plan())


def test_the_automatic_cut_is_the_cheapest_of_its_choices():
    def kinds(parts):
        return [s.scheme.explicit for s in parts.subdomains]

    # one part of elements with equal steps: nothing to cut
    even = structures.plate(20, 20, 0.1, E=1.0, nu=0.3, rho=1.0, mass="lumped")
    assert kinds(pm.cut(even, parts="auto", dt=0.05)) == [True]
    # a few elements ten thousand times as stiff at the end of a rod
    EA = np.repeat([1.0, 1e8], [3997, 3])
    rod = structures.rod(4000, 4000.0, EA=EA, rhoA=1.0, mass="lumped")
    mixed = pm.cut(rod, parts="auto", dt=0.8)
    assert kinds(mixed) == [True, False] and mixed.subdomains[1].n <= 12
    # a step far above the critical one of every element
    coarse = pm.cut(even, parts="auto", dt=50.0)
    assert kinds(coarse) == [False]
    for parts in (mixed, coarse):
        costs = [plan.cost for plan in parts.choices.values()]
        assert len(costs) >= 2 and parts.plan().cost == min(costs)
        assert parts.plan().uncut_steps == max(p.uncut_steps for p in parts.choices.values())


def test_elements_without_mass_are_implicit_in_an_automatic_cut():
    dofs = np.column_stack([np.arange(300), np.arange(1, 301)])
    masses = np.ones((300, 2))
    masses[150:153] = 0.0
    group = pm.Elements(dofs, masses, np.broadcast_to(K2, (300, 2, 2)))
    parts = pm.cut(group, parts="auto", dt=0.5)
    assert "explicit" not in parts.choices
    # dofs 151 and 152 have no mass, in an implicit subdomain
    owner = next(s for s, own in zip(parts.subdomains, parts.dofs.values()) if 151 in own)
    assert not owner.scheme.explicit
    run = parts.coupler(coupling="gc").run(steps=5)
    assert parts.gather(run).u.shape == (6, 301)


def test_an_automatic_cut_is_for_linear_structures():
    sheet = rubber(np.random.default_rng(SEED))
    with pytest.raises(ValueError, match='structure must be linear with parts="auto"'):
        pm.cut(sheet, parts="auto", dt=0.1)


# the mast is hinged to the corner, as in the uncut structure
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_named_groups_of_a_mesh_with_beams_are_cut_at_any_mass():
    """A square with a mast: rotations are dofs of the mast only."""
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 2.0], [0.0, 3.0]])
    cells = [("quad", [[0, 1, 2, 3]]), ("line", [[3, 4], [4, 5]])]
    sets = {"block": [[0], []], "mast": [[], [0, 1]]}
    mesh = meshio.Mesh(points, cells, cell_sets=sets)
    material = {
        "block": {"E": 1.0, "nu": 0.3, "rho": 1.0},
        "mast": {"EA": 1.0, "EI": 1.0, "rhoA": 1.0},
    }
    for mass in ("lumped", "consistent"):
        whole = structures.from_mesh(mesh, material, mass=mass)
        fixed = np.union1d(whole.unused, whole.dofs([0, 1], ["ux", "uy"]))
        v0 = np.ones(whole.n)
        v0[fixed] = 0.0
        one, expand = uncut(whole, fixed=fixed, scheme=pm.Newmark(), v0=v0)
        parts = pm.cut(whole, whole.labels(), fixed=fixed, scheme=pm.Newmark(), v0=v0)
        assert [(s.name, s.n) for s in parts.subdomains] == [("block", 4), ("mast", 9)]
        compare(parts, one, expand, 0.05, 10)
        assert len(pm.cut(whole, "steps", dt=0.1, fixed=fixed).subdomains) >= 1


def test_fixed_dofs_have_the_names_of_the_structure():
    bar = structures.rod(6, 3.0, EA=2.0, rhoA=1.0)
    by_number, by_name = (
        pm.cut(bar, [0, 0, 0, 1, 1, 1], scheme=pm.Newmark(), fixed=fixed)
        for fixed in ([0, 6], ["ux 0", "ux 6"])
    )
    for one, other in zip(by_number.subdomains, by_name.subdomains):
        np.testing.assert_array_equal(one.K.toarray(), other.K.toarray())
    with pytest.raises(ValueError, match="fixed must be dofs by name, got 'uy 0'"):
        pm.cut(bar, [0, 0, 0, 1, 1, 1], scheme=pm.Newmark(), fixed="uy 0")
