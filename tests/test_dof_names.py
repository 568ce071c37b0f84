"""Dofs by name, and by numbers that count from the end, wherever dofs are given."""

import numpy as np
import pytest

import pmalpha as pm

K = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
NAMES = ["foot", "floor", "roof"]


def frame(**options):
    return pm.Subdomain(
        np.ones(3),
        K,
        scheme=pm.Newmark(),
        v0=[0.0, 0.0, 1.0],
        name="frame",
        dof_names=NAMES,
        **options,
    )


def rig(**options):
    return pm.Subdomain([1.0, 1.0], [4.0, 4.0], scheme=pm.Newmark(), name="rig", **options)


def run(a, b, ties, **options):
    return pm.Coupler([a, b], ties, dt=0.1, coupling="gc").run(steps=6, **options)


def same(one, other):
    for x, y in zip(one.subdomains, other.subdomains, strict=True):
        np.testing.assert_array_equal(x.u, y.u)


@pytest.mark.parametrize("by_object", [True, False])
@pytest.mark.parametrize("dof", ["foot", -3, ["foot"], np.array(["foot"])])
def test_a_tie_takes_names_and_numbers_from_the_end(by_object, dof):
    a, b = frame(), rig()
    sides = (a, b) if by_object else ("frame", "rig")
    expected = run(a, b, pm.tie(a, 0, b, 1))
    same(run(a, b, pm.tie(sides[0], dof, sides[1], -1)), expected)


def test_springs_take_names():
    springs = [
        pm.CubicSpring([("roof", "foot"), ("floor", "ground"), (-1, "roof")], 2.0, 3.0),
        pm.Gap(["roof", -3], 5.0, 0.01),
    ]
    numbers = [pm.CubicSpring([(2, 0), (1, -1), (-1, 2)], 2.0, 3.0), pm.Gap([2, 0], 5.0, 0.01)]
    ties = pm.tie("frame", 0, "rig", 0)
    for argument in ("restoring", "internal"):
        one, other = (frame(**{argument: given}) for given in (springs, numbers))
        same(run(one, rig(), ties), run(other, rig(), ties))
        assert [x.dofs.tolist() for x in one.springs] == [x.dofs.tolist() for x in numbers]
    behind = (pm.rig.SimulatedActuator(given, delay=0.1) for given in (springs, numbers))
    same(*(run(frame(restoring=x), rig(), ties) for x in behind))
    exact = (pm.DiscreteGradient(pm.CubicSpring(x, 2.0, 3.0)) for x in (["roof"], [2]))
    same(*(run(frame(internal=x), rig(), ties) for x in exact))


def test_supports_records_outputs_and_states_take_names():
    a, b = frame(), rig()
    motion = pm.SupportMotion(np.sin(np.arange(40.0)), 0.1, "acceleration")
    driven = pm.Constraint({"frame": ["foot"]}, velocity=motion)
    by_number = pm.Constraint({"frame": [[1.0, 0.0, 0.0]]}, velocity=motion)
    outputs = {"frame": {"drift": {"roof": 1.0, "floor": -1.0}, "speed": {"v": {-1: 2.0}}}}
    outputs["frame"]["both"] = {"a": ["roof", "foot"]}
    history = run(a, b, driven, record={"frame": ["roof", 0], "rig": -1}, outputs=outputs)
    whole = run(a, b, by_number)
    u, v = whole["frame"].u, whole["frame"].v
    np.testing.assert_array_equal(history["frame"].u, u[:, [2, 0]])
    np.testing.assert_array_equal(history["rig"].dofs, [1])
    np.testing.assert_allclose(history["frame"].outputs["drift"][:, 0], u[:, 2] - u[:, 1])
    np.testing.assert_allclose(history["frame"].outputs["speed"][:, 0], 2.0 * v[:, 2])
    np.testing.assert_array_equal(history["frame"].outputs["both"], whole["frame"].a[:, [2, 0]])
    coupler = pm.Coupler([a, b], driven, dt=0.1, coupling="gc")
    coupler.step(6)
    assert coupler.state("frame")["roof"].u == u[-1, 2] == coupler.state("frame")[-1].u
    for key in ("roof", 2, -1):
        roof = history["frame"][key]
        np.testing.assert_array_equal(roof.u, u[:, 2])
        np.testing.assert_array_equal(roof.t, history["frame"].t)
    with pytest.raises(ValueError, match="must have been recorded, got 1; recorded are 2, 0"):
        history["frame"][1]


@pytest.mark.parametrize(
    "use",
    [
        lambda a, b: pm.tie(a, "rof", b, 0),
        lambda a, b: run(a, b, pm.tie("frame", "rof", "rig", 0)),
        lambda a, b: frame(restoring=pm.Gap(["rof"], 1.0, 0.0)),
        lambda a, b: run(a, b, None, record={"frame": "rof", "rig": None}),
        lambda a, b: run(a, b, None, outputs={"frame": {"x": {"rof": 1.0}}}),
        lambda a, b: run(a, b, None, outputs={"frame": {"x": ["rof"]}}),
        lambda a, b: run(a, b, None)["frame"]["rof"],
        lambda a, b: run(a, b, None).plot({"frame": "rof"}),
    ],
)
@pytest.mark.filterwarnings("ignore:no constraint:pmalpha.ConstraintWarning")
def test_an_unknown_name_is_an_error_with_the_nearest_one(use):
    with pytest.raises(ValueError, match=r"got 'rof'; the nearest is 'roof'"):
        use(frame(), rig())


def test_names_without_dof_names_and_wrong_names_are_refused():
    with pytest.raises(TypeError, match="since there are no dof_names, got 'roof'"):
        pm.tie(rig(), "roof", frame(), 0)
    for names, error in ((["a"], ValueError), (["a", "a"], ValueError), (["a", 1], TypeError)):
        with pytest.raises(error, match="dof_names must be"):
            rig(dof_names=names)
    with pytest.raises(TypeError, match="dof_names must be a list"):
        rig(dof_names="ab")


@pytest.mark.gate
def test_files_and_tables_have_the_names(tmp_path):
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("pandas")
    a, b = frame(), rig()
    ties = pm.tie("frame", "foot", "rig", 0)
    history = run(a, b, ties, record_to=tmp_path / "run.h5")
    history.save(tmp_path / "run.npz")
    for name in ("run.h5", "run.npz"):
        loaded = pm.History.load(tmp_path / name)
        np.testing.assert_array_equal(loaded["frame"]["roof"].u, history["frame"].u[:, 2])
        assert loaded["rig"][-1].name == "1"
    with h5py.File(tmp_path / "run.h5") as file:
        np.testing.assert_array_equal(file["frame/u"], history["frame"].u)
        assert file["frame/dof_names"][()].tolist() == [x.encode() for x in NAMES]
    assert history.to_pandas()["frame"]["u", "roof"].tolist() == history["frame"].u[:, 2].tolist()
    pytest.importorskip("xarray")
    roof = history.to_xarray()["frame_u"].sel(frame_dof="roof")
    np.testing.assert_array_equal(roof, history["frame"].u[:, 2])


def test_dofs_of_a_mesh_have_names_whatever_is_fixed():
    mesh = pm.structures.beam_frame([[0, 0], [0, 3], [4, 3]], [[0, 1], [1, 2]], EA=9.0, EI=1.0,
                                    rhoA=1.0)  # fmt: skip
    held = mesh.subdomain(scheme=pm.Newmark(), fixed=mesh.dofs(0), name="mesh")
    assert list(held.dof_names) == ["ux 1", "uy 1", "rz 1", "ux 2", "uy 2", "rz 2"]
    assert held.dof_names.index("uy 2") == 4
    np.testing.assert_array_equal(
        held.K.toarray(),
        pm.reduce(mesh.M, mesh.K, fixed=["rz 0", 0, 1], dof_names=mesh.dof_names).K.toarray(),
    )
    with pytest.raises(ValueError, match="got 'ux 0'; the nearest is"):
        pm.tie(held, "ux 0", rig(), 0)
    small, basis = held.reduced(["ux 1", -1], modes=1)
    assert basis.place("rz 2") == 1
    parts = pm.cut(mesh, [0, 1], fixed=[0, 1, 2], u0=np.zeros(9))
    history = parts.coupler(dt=0.1, coupling="gc").run(steps=2)
    assert parts.gather(history)["ux 2"].name == "ux 2"
    assert history[1]["ux 2"].u.shape == (3,)


def test_drifts_and_base_shear_of_a_frame_need_no_formula():
    """Two storeys with two bays: the drifts and the force of the feet from all dofs."""
    x, y = np.meshgrid([0.0, 4.0, 9.0], [0.0, 3.0, 6.0])
    points = np.column_stack([x.ravel(), y.ravel()])
    columns = [(i, i + 3) for i in range(6)]
    beams = [(i, i + 1) for i in (3, 4, 6, 7)]
    building = pm.structures.beam_frame(
        points, columns + beams, EA=1e4, EI=50.0, rhoA=1.0, divisions=2
    )
    feet = building.dofs([0, 1, 2])
    held = building.subdomain(
        scheme=pm.GeneralizedAlpha(0.8),
        fixed=feet,
        name="held",
        force=lambda t: np.full(building.n - feet.size, 0.1),
    )
    outputs = {"drift": building.storey_drifts(), "shear": building.base_shear()}
    motion = pm.solve(held, dt=0.02, steps=20, outputs={"held": outputs})
    whole = pm.reduce(building.M, building.K, fixed=feet).expand(motion.u)
    mean = [whole[:, building.dofs(nodes, "ux")].mean(axis=1) for nodes in floors(building)]
    np.testing.assert_allclose(
        motion.outputs["drift"], np.diff(np.array(mean), axis=0).T, atol=1e-15
    )
    forces = (whole @ building.K)[:, building.dofs([0, 1, 2], "ux")].sum(axis=1)
    np.testing.assert_allclose(motion.outputs["shear"][:, 0], forces, atol=1e-12)
    with pytest.raises(ValueError, match="storey_drifts needs elements 'line'"):
        pm.structures.plate(1, 1, 1.0, E=1.0, nu=0.2, rho=1.0).storey_drifts()


def floors(building):
    """Feet, and all nodes of the beams at each height, also those within a span."""
    return [np.array([0, 1, 2]), building.nodes_at(y=3.0), building.nodes_at(y=6.0)]


def test_the_shear_of_a_storey_is_that_of_the_static_load_above_it():
    points = [[x, y] for y in (0.0, 3.0, 6.0) for x in (0.0, 4.0)]
    members = [[0, 2], [1, 3], [2, 4], [3, 5], [2, 3], [4, 5]]
    frame = pm.structures.beam_frame(points, members, EA=1e3, EI=10.0, rhoA=1.0, divisions=3)
    feet = frame.dofs(frame.nodes_at(y=0.0))
    free = np.setdiff1d(np.arange(frame.n), feet)
    load = np.zeros(frame.n)
    load[frame.dofs([2, 4, 5], "ux")] = 5.0, 1.0, 2.0  # at both levels
    u = np.zeros(frame.n)
    u[free] = np.linalg.solve(frame.K.toarray()[np.ix_(free, free)], load[free])
    # statics: all of the load acts on the first storey, that of the roof on the second
    assert frame.storey_shears() @ u == pytest.approx([-8.0, -3.0], rel=1e-9)
    assert frame.storey_shears() @ u == pytest.approx([(frame.base_shear() @ u)[0], -3.0], rel=1e-9)
    with pytest.raises(ValueError, match="storey_shears needs elements 'line'"):
        pm.structures.plate(1, 1, 1.0, E=1.0, nu=0.2, rho=1.0).storey_shears()
