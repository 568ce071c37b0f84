"""Save and load: a resumed run is bitwise identical to the uninterrupted one."""

import json
import os
import textwrap

import numpy as np
import pytest
import waits
from counted import COUNTING, counting, yielding

import pmalpha as pm
from pmalpha.run import checkpoint


def sampled(n, seed):
    return pm.SampledForce(np.random.default_rng(seed).standard_normal((40, n)), 0.13)


def chain(n, k=100.0):
    K = 2.0 * k * np.eye(n) - k * np.eye(n, k=1) - k * np.eye(n, k=-1)
    return np.ones(n), K


def coupler(*, n=6, force=None, coupling="pm", double=None, substeps=4, moved=False, threads=None):
    """Three subdomains; by default b takes double steps with substeps."""
    soft = pm.GeneralizedAlpha(0.5)
    M, K = chain(n)
    u0 = np.random.default_rng(3).random(n)
    u0[[0, -1]] = 0.0  # no gap to the ground and to b
    a = pm.Subdomain(M, K, C=0.01 * K, scheme=soft, force=force, u0=u0, name="a")
    b = pm.Subdomain(
        M, K, scheme=soft, substeps=2, double_step=double, force=sampled(n, 1), name="b"
    )
    c = pm.Subdomain(M, K, scheme=pm.CentralDifference(), substeps=substeps, name="c")
    constraints = [pm.tie(a, [5], b, [0]), pm.tie(b, [5], c, [0])]
    if moved:
        constraints.append(pm.Constraint({a: np.eye(n)[:1]}, velocity=lambda t: [np.sin(t)]))
    return pm.Coupler([a, b, c], constraints, dt=0.1, coupling=coupling, threads=threads)


def snapshot(c):
    """The whole state, as bytes."""
    nodes = [x.tobytes() for part in c._session.members for x in part.core.levels().values()]
    return c.step_count, c.multipliers.tobytes(), c._session.core.prescribed.tobytes(), nodes


def require_same_history(ours, theirs):
    for x, y in zip(ours.subdomains, theirs.subdomains):
        for name in "tuva":
            assert getattr(x, name).tobytes() == getattr(y, name).tobytes()
    for name in ("multipliers", "velocity_jump", "displacement_jump", "multiplier_times"):
        assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes()


# ---- going on -------------------------------------------------------------------------------


def test_one_coupler_can_load_an_earlier_and_a_later_state(tmp_path):
    times = []

    def force(t):
        times.append(t)
        return np.full(6, np.sin(t))

    c = coupler(force=force)
    c.step(4)
    c.save(tmp_path / "state")
    del times[:]
    first = c.run(steps=3)
    c.load(tmp_path / "state")
    assert c.step_count == 4 and c.last_history is None
    require_same_history(c.run(steps=3), first)
    # a callable is evaluated again at the times that are run again, and at no other
    np.testing.assert_array_equal(times, 2 * list(first["a"].t[1:]))
    c.reset()
    assert c.step_count == 0
    np.testing.assert_array_equal(c.state("a").u, coupler().state("a").u)


def test_a_loaded_coupler_evaluates_no_load_for_the_start(tmp_path):
    times = []
    c, other = coupler(force=lambda t: np.zeros(6)), coupler(force=lambda t: times.append(t))
    c.step(2)
    c.save(tmp_path / "state")
    other.load(tmp_path / "state")
    assert other.step_count == 2 and not times


def in_another_process(code, path):
    """A program that has this module as `here`, a coupler `c` and the path `path`."""
    head = f"import test_checkpoint as here\nc, path = here.coupler(), {str(path)!r}\n"
    return waits.program(head + textwrap.dedent(code))


def test_a_state_saved_in_one_process_resumes_in_another(tmp_path):
    path = tmp_path / "state"
    done = in_another_process("c.step(5); c.save(path)", path)
    assert done.returncode == 0, done.stderr
    resumed, whole = coupler(), coupler()
    whole.step(5)
    resumed.load(path)
    require_same_history(resumed.run(steps=4), whole.run(steps=4))


# ---- another problem ------------------------------------------------------------------------


OPTIONS = ("scheme", "substeps", "double_step", "damping", "restoring", "force", "name")


def two_subdomains(**changes):
    """Two subdomains of one dof each, with `changes` of their data."""
    chosen = {
        "M": [1.0],
        "K": [4.0],
        "C": None,
        "scheme": pm.GeneralizedAlpha(0.5),
        "substeps": 3,
        "double_step": False,
        "damping": "implicit",
        "restoring": None,
        "force": [1.0],
        "name": "b",
        "dt": 0.1,
        "coupling": "pm",
        "start": "rebased",
        "L": 1.0,
        "velocity": None,
    } | changes
    options = {x: chosen[x] for x in OPTIONS}
    a = pm.Subdomain([1.0], [4.0], scheme=pm.GeneralizedAlpha(0.5), name="a")
    b = pm.Subdomain(chosen["M"], chosen["K"], C=chosen["C"], **options)
    constraints = pm.Constraint({a: [[1.0]], b: [[-chosen["L"]]]}, velocity=chosen["velocity"])
    options = {x: chosen[x] for x in ("dt", "coupling", "start")}
    return pm.Coupler([a, b], constraints, **options)


DIFFERENCES = {
    "M": ([2.0], "M of 'b' (checksum"),
    "K": ([4.5], "K of 'b' (checksum"),
    "C": ([0.1], "C of 'b' (zero in the file, checksum"),
    "damping": ("lagged", "damping of 'b' (implicit in the file, lagged here)"),
    "restoring": (lambda t, u, v: u, "restoring of 'b' (none in the file, a callable here)"),
    "scheme": (pm.GeneralizedAlpha(0.6), "scheme of 'b' ([0.0, 0.3333"),
    "substeps": (6, "substeps of 'b' (3 in the file, 6 here)"),
    "force": ([2.0], "force of 'b' (checksum"),
    "name": ("c", "names (['a', 'b'] in the file, ['a', 'c'] here)"),
    "dt": (0.2, "dt (0.1 in the file, 0.2 here)"),
    "coupling": ("gc", "coupling (pm in the file, gc here)"),
    "start": ("plain", "start (rebased in the file, plain here)"),
    "L": (2.0, "conditions on 'b' (checksum"),
    "velocity": ([0.0], "velocity of constraint 0 (not given in the file, checksum"),
}


@pytest.mark.parametrize("what", DIFFERENCES)
def test_another_problem_is_refused_with_what_differs(tmp_path, what):
    value, message = DIFFERENCES[what]
    saved, other = two_subdomains(), two_subdomains(**{what: value})
    saved.step(2)
    saved.save(tmp_path / "state")
    other.step()
    before = snapshot(other)
    with pytest.raises(ValueError, match="a checkpoint of the same problem") as caught:
        other.load(tmp_path / "state")
    assert message in str(caught.value)
    assert snapshot(other) == before
    # and nothing else is reported to differ
    if what not in ("name", "coupling"):
        assert str(caught.value).count(" in the file, ") == 1


def test_sampled_loads_are_compared_by_their_numbers_and_callables_are_not(tmp_path):
    values = np.linspace(0.0, 1.0, 9)[:, None]
    saved = two_subdomains(force=pm.SampledForce(values, 0.1))
    saved.save(tmp_path / "sampled")
    two_subdomains(force=pm.SampledForce(values.copy(), 0.1)).load(tmp_path / "sampled")
    for other in (
        pm.SampledForce(values, 0.11),
        pm.SampledForce(2.0 * values, 0.1),
        pm.SampledForce(values, 0.1, shape=[1.0]),
        pm.BaseAcceleration(-values, [1.0], [1.0], dt=0.1),
        lambda t: [0.0],
        None,
    ):
        with pytest.raises(
            ValueError, match="force of 'b' \\(SampledForce checksum .* in the file"
        ):
            two_subdomains(force=other).load(tmp_path / "sampled")
    two_subdomains(force=lambda t: [0.0]).save(tmp_path / "callable")
    two_subdomains(force=lambda t: [1.0]).load(tmp_path / "callable")


def test_the_loads_that_count_are_those_of_the_last_reset(tmp_path):
    saved, other = two_subdomains(), two_subdomains()
    saved.reset(force={"b": [7.0]})
    saved.step(2)
    saved.save(tmp_path / "state")
    with pytest.raises(ValueError, match="force of 'b'"):
        other.load(tmp_path / "state")
    other.reset(u0={"a": [1.0], "b": [1.0]}, force={"b": [7.0]})  # initial values are not compared
    other.load(tmp_path / "state")
    assert snapshot(other) == snapshot(saved)


def test_many_differences_are_counted(tmp_path):
    saved = two_subdomains()
    saved.save(tmp_path / "state")
    other = two_subdomains(M=[2.0], K=[1.0], C=[0.1], force=None, dt=0.3, L=3.0, start="plain")
    with pytest.raises(ValueError, match=r"\.\.\. \(7 in all\)"):
        other.load(tmp_path / "state")


def test_the_elimination_order_does_not_belong_to_the_problem(tmp_path):
    # the file has dofs and constraints in the user's order
    c = coupler()
    c.step(3)
    c.save(tmp_path / "state")
    with np.load(tmp_path / "state") as file:
        for i, name in enumerate("abc"):
            np.testing.assert_array_equal(file[f"{i}.u"], c.state(name).u)
            np.testing.assert_array_equal(file[f"{i}.w"], c.state(name).a)
        np.testing.assert_array_equal(file["multipliers"], c.multipliers)
        # stored free velocities by dof: a's only one is dof 5, whose free and total differ
        assert file["0.vf"].shape == (1,) and file["1.previous_vf"].shape == (2,)
        jump = file["0.vf"][0] - file["1.vf"][0]
        assert jump != 0.0
    # vf is permuted as u is where both interface dofs of b count
    part = c._session.members[1]
    positions = checkpoint.order_of(part, "vf", np.empty(2))
    np.testing.assert_array_equal(part.order[part.n - 2 :][positions], [0, 5])


# ---- files ----------------------------------------------------------------------------------


def saved_state(path):
    c = two_subdomains()
    c.step(4)
    c.save(path)
    return c


def rewritten(path, header=None, **arrays):
    """The file with some entries changed; None removes one."""
    with np.load(path) as file:
        content = dict(file)
    if header is not None:
        content["header"] = np.array(json.dumps(json.loads(content["header"].item()) | header))
    content |= arrays
    with open(path, "wb") as file:
        np.savez(file, **{key: x for key, x in content.items() if x is not None})


DAMAGE = {
    "lacks the multipliers": {"multipliers": None},
    "a state of another size": {"1.u": np.zeros(2)},
    "a state of another type": {"1.w": np.zeros(1, dtype=np.float32)},
    "a state that is not finite": {"0.a": np.array([np.nan])},
    "no problem": {"header": {"problem": None}},
    "a step that is none": {"header": {"step_count": 2.5}},
    "a step before the first": {"header": {"step_count": -1}},
    "a step that no counter holds": {"header": {"step_count": 2**60}},
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_an_incomplete_file_is_refused_and_nothing_changes(tmp_path, damage):
    path = tmp_path / "state"
    c = saved_state(path)
    before = snapshot(c)
    c.load(path)  # it was good
    rewritten(path, **DAMAGE[damage])
    with pytest.raises(ValueError, match="path must lead to a whole file of format"):
        c.load(path)
    assert snapshot(c) == before


NO_COUNTS = (-1.0, 0.5, 2.0**53 + 2.0, 1e300, -1e300)


@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning", "ignore::pmalpha.AccuracyWarning")
@pytest.mark.parametrize("kind", COUNTING)
def test_a_number_that_is_counted_with_is_a_count_or_refused(tmp_path, kind):
    """Those that count are found by the refusals, and are as many as the devices have."""
    path = tmp_path / "state"
    restoring, expected = COUNTING[kind]
    c, d = counting(restoring), counting(restoring)
    c.step(3)
    c.save(path)
    with np.load(path) as file:
        springs = file["0.springs"]
    d.load(path)
    before = snapshot(d)
    problem = d._session.assembly, d._session.core_rows, d._session.options
    arrays = checkpoint.state_arrays(*problem)

    def is_refused(k, bad):
        changed = {"0.springs": np.r_[springs[:k], bad, springs[k + 1 :]]}
        try:
            checkpoint.core_state(path, arrays | changed, *problem)
        except ValueError:
            return True
        return False

    refused = [k for k in range(springs.size) if is_refused(k, NO_COUNTS[0])]
    assert len(refused) == expected
    assert all(is_refused(k, bad) for k in refused for bad in NO_COUNTS)
    rewritten(path, **{"0.springs": springs})
    d.load(path)
    assert snapshot(d) == before
    np.testing.assert_array_equal(c.run(steps=4)["a"].u, d.run(steps=4)["a"].u)


def test_a_refusal_of_a_count_says_which_and_why(tmp_path):
    path = tmp_path / "state"
    c = counting(yielding)
    c.step(3)
    c.save(path)
    before = snapshot(c)
    with np.load(path) as file:
        springs = file["0.springs"]
    springs[2] = 13.0
    rewritten(path, **{"0.springs": springs})
    with pytest.raises(
        ValueError, match=r"springs must have a whole number in 0..12 at 2, got 13$"
    ):
        c.load(path)
    assert snapshot(c) == before


@pytest.mark.gate
def test_the_number_of_corrections_of_many_multipliers_is_a_count(tmp_path):
    """Up to 500 constraints a matrix is kept, and no count."""
    path, n = tmp_path / "state", 501
    spring = pm.CubicSpring([0], k=1.0, k3=2.0)
    a, b = (
        pm.Subdomain(np.ones(n), np.ones(n), scheme=pm.Newmark(), internal=x, v0=np.ones(n))
        for x in (spring, None)
    )
    c = pm.Coupler([a, b], pm.tie(a, range(n), b, range(n)), dt=0.05, coupling="macro")
    c.step(2)
    c.save(path)
    with np.load(path) as file:
        shooting = file["shooting"]
    assert shooting[1 + n] > 0.0
    for bad in NO_COUNTS:
        rewritten(path, shooting=np.r_[shooting[: 1 + n], bad, shooting[2 + n :]])
        with pytest.raises(ValueError, match=f"shooting must have a whole number .* at {1 + n},"):
            c.load(path)
    rewritten(path, shooting=shooting)
    c.load(path)
    c.step(1)


def test_a_file_that_is_cut_off_is_refused_and_nothing_changes(tmp_path):
    path = tmp_path / "state"
    c = saved_state(path)
    c.step()
    before, whole = snapshot(c), path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 15).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="is no npz file, or is cut off"):
            c.load(path)
        assert snapshot(c) == before


def test_a_file_of_another_kind_is_refused(tmp_path):
    c = two_subdomains()
    c.run(steps=2).save(tmp_path / "history")
    with pytest.raises(ValueError, match="is of format 'pmalpha History'"):
        c.load(tmp_path / "history")
    (tmp_path / "text").write_text("u v w")
    with pytest.raises(ValueError, match="is no npz file"):
        c.load(tmp_path / "text")
    c.save(tmp_path / "state")
    with pytest.raises(ValueError, match="is of format 'pmalpha checkpoint'"):
        pm.History.load(tmp_path / "state")
    with pytest.raises(FileNotFoundError):
        c.load(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe")
    for endless in ("/dev/zero", tmp_path / "pipe"):
        for load in (c.load, pm.History.load):
            with pytest.raises(OSError, match="path cannot be read: a device or a pipe"):
                load(endless)
    for call in (c.save, c.load):
        with pytest.raises(TypeError, match="path must be a str or a path, got 3"):
            call(3)


def test_a_file_that_cannot_be_written_is_named_and_the_coupler_continues(tmp_path):
    c, other = two_subdomains(), two_subdomains()
    with pytest.raises(FileNotFoundError, match="path cannot be written.*nowhere/state'"):
        c.save(tmp_path / "nowhere" / "state")
    with pytest.raises(OSError, match="path cannot be written: a folder or a device"):
        c.save("/dev/full")
    c.step(2)
    other.step(2)
    assert snapshot(c) == snapshot(other)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_keeps_the_old_file_and_the_coupler(tmp_path):
    path = tmp_path / "state"
    before = coupler()
    before.save(path)
    good = path.read_bytes()
    done = in_another_process(
        """
        import resource
        c.step(3)
        at = here.snapshot(c)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        try:
            c.save(path)
        except OSError as error:
            print(error)
        assert here.snapshot(c) == at
        c.step(1)
        """,
        path,
    )
    assert done.returncode == 0, done.stderr
    assert "path cannot be written: File too large" in done.stdout and str(path) in done.stdout
    assert path.read_bytes() == good
    assert [file.name for file in tmp_path.iterdir()] == ["state"]


def test_a_load_cannot_save_or_load_the_coupler_that_evaluates_it(tmp_path):
    errors = []

    def force(t):
        for call in (c.save, c.load):
            with pytest.raises(RuntimeError, match="being stepped") as caught:
                call(tmp_path / "state")
            errors.append(caught)
        return [0.0]

    c = two_subdomains(force=force)
    c.step()
    assert errors and not list(tmp_path.iterdir())


def test_the_matrices_are_read_once_for_any_number_of_files(tmp_path, monkeypatch):
    c = two_subdomains()
    c.save(tmp_path / "state")
    monkeypatch.setattr(checkpoint, "constants", None)
    c.save(tmp_path / "state")
    c.load(tmp_path / "state")
