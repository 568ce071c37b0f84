"""A run with internal forces is bitwise the same however it is computed, kept and recorded."""

import functools

import numpy as np
import pytest
from newton_coupled import VARIANTS, plastic_pair, same_bits
from pairwise import in_turn
from test_checkpoint import snapshot

import pmalpha as pm

pytestmark = pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")

STEPS = 6
variants = pytest.mark.parametrize("variant", VARIANTS)


def made(variant, tangent="reuse", **options):
    """The coupler; "reuse" keeps all that there is."""
    return plastic_pair(variant, newton=pm.Newton(tangent=tangent), **options)


@functools.cache
def whole_run(variant, tangent="reuse"):
    c = made(variant, tangent)
    history = c.run(steps=STEPS)
    assert abs(history["a"].q).max() > 1e-3 and abs(history["b"].q).max() > 1e-3  # both yield
    return history, snapshot(c)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("variant", "tangent", "threads"),
    list(zip(VARIANTS, ["full", "reuse", "reuse", "full"], [2, 3, 2, 3])),
)
def test_the_number_of_threads_changes_no_bit(variant, tangent, threads):
    history, end = whole_run(variant, tangent)
    c = made(variant, tangent, threads=threads)
    same_bits(c.run(steps=STEPS), history)
    assert snapshot(c) == end


@pytest.mark.gate
@variants
def test_steps_one_by_one_and_runs_in_pieces_are_the_whole_run(variant):
    history, end = whole_run(variant)
    c = made(variant)
    for _ in range(STEPS):
        c.step()
    assert snapshot(c) == end
    c = made(variant)
    pieces = [c.run(steps=k) for k in (1, 2, 3)]
    assert snapshot(c) == end
    for i, x in enumerate(history):
        for name in ("u", "v", "a", "q", "iterations"):
            if getattr(x, name) is not None:
                parts = [getattr(piece[i], name)[int(k > 0) :] for k, piece in enumerate(pieces)]
                np.testing.assert_array_equal(np.concatenate(parts), getattr(x, name))


@pytest.mark.gate
@pytest.mark.parametrize(("variant", "steps"), in_turn(VARIANTS, 2, 5, 0))
def test_a_loaded_state_goes_on_as_the_saved_one(tmp_path, variant, steps):
    _, end = whole_run(variant)
    one, other = made(variant), made(variant)
    one.step(steps)
    one.save(tmp_path / "state")
    other.step(4)  # somewhere else
    other.load(tmp_path / "state")
    assert snapshot(other) == snapshot(one)
    for c in (one, other):
        c.step(STEPS - steps)
        assert snapshot(c) == end


@pytest.mark.gate
@variants
def test_reset_forgets_histories_scales_and_tangents(variant):
    history, end = whole_run(variant)
    c = made(variant)
    c.step(3)
    c.reset()
    same_bits(c.run(steps=STEPS), history)
    assert snapshot(c) == end


@pytest.mark.gate
@pytest.mark.parametrize("variant", ["pm", "macro, double step"])
def test_reset_to_another_motion_is_a_coupler_of_that_motion(variant):
    c, other = made(variant), made(variant)
    c.step(3)
    u0 = {"a": np.linspace(0.0, 0.04, 5), "b": np.full(5, 0.04), "c": np.full(5, 0.04)}
    v0 = {name: np.zeros(5) for name in "abc"}
    for x in (c, other):
        x.reset(u0=u0, v0=v0)
    history = c.run(steps=4)
    same_bits(history, other.run(steps=4))
    assert history["a"].u[0, -1] == 0.04


RECORDS = [
    {"record": {}},
    {"record": {"a": [1], "b": None}},
    {"every": 4},
    {"energy": True},
    {"energy": True, "every": 3, "record": {"b": [0]}},
    {"outputs": {"a": {"first": np.eye(5)[:1]}}},
]


@pytest.mark.gate
@pytest.mark.parametrize(("options", "variant"), in_turn(RECORDS, "macro", *VARIANTS))
def test_what_is_recorded_changes_no_bit(options, variant):
    history, end = whole_run(variant)
    c = made(variant)
    recorded = c.run(steps=STEPS, **options)
    assert snapshot(c) == end
    if options == {"every": 4}:
        for x, y, ss in zip(recorded, history, (1, 4, 8)):
            levels = [*range(0, STEPS, 4)]
            np.testing.assert_array_equal(x.u[: len(levels)], y.u[np.multiply(levels, ss)])
            if x.q is not None:
                np.testing.assert_array_equal(x.q[: len(levels)], y.q[np.multiply(levels, ss)])


@pytest.mark.gate
@pytest.mark.parametrize("variant", ["pm", "macro"])
def test_a_file_that_is_continued_holds_the_whole_run(tmp_path, variant):
    pytest.importorskip("h5py")
    history, end = whole_run(variant)
    path = tmp_path / "run.h5"
    c = made(variant)
    c.run(steps=4, record_to=path)
    c.save(tmp_path / "state")
    other = made(variant)
    other.load(tmp_path / "state")
    other.run(steps=STEPS - 4, record_to=path, append=True)
    assert snapshot(other) == end
    same_bits(pm.History.load(path), history)


def test_a_saved_history_has_iterations_and_histories(tmp_path):
    history, _ = whole_run("pm")
    history.save(tmp_path / "run.npz")
    same_bits(pm.History.load(tmp_path / "run.npz"), history)


def test_a_file_of_other_parameters_is_refused(tmp_path):
    c = made("pm")
    c.step(3)
    c.save(tmp_path / "state")
    other = plastic_pair("pm", newton=pm.Newton(tol=1e-6))
    other.step(2)
    before = snapshot(other)
    with pytest.raises(ValueError, match="newton"):
        other.load(tmp_path / "state")
    assert snapshot(other) == before


# ---- energy ---------------------------------------------------------------------------------


@pytest.mark.parametrize("coupling", ["gc", "pm", "macro"])
def test_the_work_of_a_linear_internal_force_is_its_strain_energy(coupling):
    # the trapezoidal rule is exact on it, and counts it as dissipated; but for the first substep,
    # at whose beginning the force counts as at its end
    K = 200.0 * (2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1))

    def energies(inside):
        how = dict(scheme=pm.Newmark(), double_step=False, v0=[0.0, 1.0, 0.0])
        given = {"K": K} if not inside else {"K": None, "internal": lambda t, u, v, q: (K @ u, K)}
        a = pm.Subdomain(np.ones(3), given.pop("K"), name="a", **given, **how)
        b = pm.Subdomain(np.ones(3), K, name="b", substeps=3, **how)
        newton = pm.Newton(tol=1e-12)
        c = pm.Coupler([a, b], pm.tie(a, [2], b, [0]), dt=0.05, coupling=coupling, newton=newton)
        return c.run(steps=30, energy=True).energy

    ours, theirs = energies(True), energies(False)
    scale = theirs.strain.max()
    assert scale > 0.1 and not ours.strain[:, 0].any()
    for one, other in (
        (ours.kinetic, theirs.kinetic),
        (ours.dissipated[:, 0], theirs.strain[:, 0]),
        (ours.strain[:, 1], theirs.strain[:, 1]),
        (ours.interface, theirs.interface),
        (ours.balance, theirs.balance),
    ):
        # rounding; under "macro" 10 times 1e-12 of the motion in each of 30 steps
        assert abs(np.diff(one - other, axis=0)[1:]).max() < 1e-9 * scale


def test_the_work_of_a_plastic_force_is_the_area_of_its_loop():
    spring = pm.Bilinear([0], k=100.0, fy=2.0, hardening=0.1)
    s = pm.Subdomain([1.0], None, scheme=pm.Newmark(), internal=spring, v0=[1.0], name="s")
    c = pm.Coupler([s], dt=0.01)
    history = c.run(steps=200, energy=True, record_springs={"s": None})
    x = history["s"]
    area = np.diff(x.deformation[:, 0]) @ (x.force[1:, 0] + x.force[:-1, 0]) / 2.0
    assert x.force.max() > 2.0 and area > 0.2
    E = history.energy
    # of a spring the part that it will return is strain energy
    assert E.strain[-1, 0] + E.dissipated[-1, 0] == pytest.approx(area, rel=1e-12)
    # 0.5 of the start is kinetic or has done this work, but for the error of the trapezoidal rule
    # of the motion at the kinks, of the order of k h^2 v^2 / 8 each
    assert abs(E.balance).max() < 20 * 100.0 * 0.01**2 / 8
