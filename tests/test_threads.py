"""Threads change only the duration of a run, and end with their coupler."""

import gc
import mmap
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import numpy as np
import pytest
import scipy.sparse as sp
import waits
from agreement import assert_identical

import pmalpha as pm
from pmalpha._cached import cached_property
from pmalpha.setup.schedule import most_threads

LINUX = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads in /proc")
IMPLICIT = pm.GeneralizedAlpha(0.5)
EXPLICIT = pm.GeneralizedAlpha(0.5, explicit=True)


def chain(n):
    return sp.csr_array(
        sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    )


def row_of_subdomains(count=4, n=20, *, dt=0.1, force=None, coupling="pm", **options):
    """Chains in a row, implicit and explicit in turn, the explicit ones with ten substeps."""
    subdomains = [
        pm.Subdomain(
            np.ones(n),
            chain(n),
            scheme=EXPLICIT if i % 2 else IMPLICIT,
            substeps=10 if i % 2 else 1,
            u0=np.sin(np.arange(i * (n - 1), (i + 1) * (n - 1) + 1.0)),
            force=force,
        )
        for i in range(count)
    ]
    ties = [pm.tie(a, [n - 1], b, [0]) for a, b in zip(subdomains, subdomains[1:])]
    return pm.Coupler(subdomains, ties, dt=dt, coupling=coupling, **options)


def tasks():
    return len(os.listdir("/proc/self/task"))


# ---- bitwise identical results ----------------------------------------------------------------


def double_and_fine(coupling="pm", **options):
    """A coarse implicit subdomain with double steps, two fine ones, all loaded."""
    n = 30
    a = pm.Subdomain(
        np.ones(n), chain(n), C=0.01 * chain(n), scheme=IMPLICIT, substeps=2,
        force=pm.SampledForce(np.sin(np.arange(200.0)), 0.07, shape=np.ones(n)), name="a",
    )  # fmt: skip
    b, c = (
        pm.Subdomain(
            np.ones(n), chain(n), scheme=EXPLICIT, substeps=10, u0=np.cos(np.arange(n)), **load
        )
        for load in ({"name": "b"}, {"name": "c", **options.pop("of_c", {})})
    )
    ties = [pm.tie(a, [n - 1], b, [0]), pm.tie(b, [n - 1], c, [0])]
    return pm.Coupler([a, b, c], ties, dt=0.5, coupling=coupling, **options)


def sums(t, u, v):
    return 0.1 * u + 0.01 * v


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(
    "of_c", [{}, {"force": lambda t: np.full(30, np.sin(t))}, {"restoring": sums}]
)
def test_double_steps_in_parallel_with_fine_ones_are_bitwise_identical(threads, of_c):
    alone, shared = (double_and_fine(threads=k, of_c=dict(of_c)) for k in (1, threads))
    assert_identical(shared.run(steps=12), alone.run(steps=12))
    assert_identical(shared.run(steps=7, every=3), alone.run(steps=7, every=3))
    for _ in range(5):
        shared.step()
    alone.step(5)
    energies = [coupler.run(steps=6, energy=True) for coupler in (shared, alone)]
    assert_identical(*energies)
    np.testing.assert_array_equal(energies[0].energy.balance, energies[1].energy.balance)
    assert_identical(shared.run(steps=6), alone.run(steps=6))


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_a_step_opened_early_is_discarded_after_a_new_load_or_a_new_state(tmp_path):
    alone, shared = (double_and_fine(threads=k) for k in (1, 3))
    path = tmp_path / "state.npz"
    shared.step(6)  # two steps of the double-step subdomain are open beyond the present time
    shared.save(path)
    shared.step(3)
    shared.load(path)
    alone.step(6)
    assert_identical(shared.run(steps=5), alone.run(steps=5))
    for coupler in (shared, alone):
        coupler.reset(force={"a": np.linspace(0.0, 1.0, 30)})
    assert_identical(shared.run(steps=5), alone.run(steps=5))
    alone.save(path)
    shared.step(2)
    shared.load(path)  # saved by one thread
    assert_identical(shared.run(steps=5), alone.run(steps=5))


def load_anew(coupler):
    part = coupler._session.members[0]
    part.core.set_load(np.linspace(0.0, 1.0, part.n))


def start_anew(coupler):
    lam = np.zeros(2)
    for part in coupler._session.members:
        u = np.cos(np.arange(part.n))
        part.core.start(u, np.zeros(part.n), -u, lam)
    coupler._session.core.start(0, lam, lam)


def move_nodes(coupler):
    part = coupler._session.members[0]
    part.core.set_levels({name: 2.0 * x for name, x in part.core.levels().items()})


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.parametrize("change", [load_anew, start_anew, move_nodes])
def test_each_change_by_itself_voids_the_steps_that_were_opened_early(change):
    # of the core: a reset of the package changes loads and state at once. One thread opens no step
    # early, so what it gives is right.
    alone, shared = (double_and_fine(threads=k) for k in (1, 3))
    for coupler in (alone, shared):
        coupler.step(6)  # two steps of the double-step subdomain are open beyond the present
        change(coupler)
        assert coupler._session.core.advance(5, None) is None
    for one, other in zip(alone._session.members, shared._session.members):
        for name, x in one.core.levels().items():
            np.testing.assert_array_equal(x, other.core.levels()[name])
    unchanged = double_and_fine(threads=1)
    unchanged.step(11)
    assert np.any(unchanged.state("a").u != alone.state("a").u)


@pytest.mark.skipif(not hasattr(mmap, "PAGESIZE"), reason="needs pages that cannot be read")
def test_a_step_is_not_opened_early_beyond_the_rows_of_a_table_of_loads():
    # the table ends where a page begins that may not be read: a row too many ends the process
    done = waits.program(
        """
        import ctypes
        import mmap
        import numpy as np
        from pmalpha.problem import forms
        from test_threads import double_and_fine

        steps, n = 6, 30  # of two substeps each
        page, count = mmap.PAGESIZE, 2 * steps * n
        pages = mmap.mmap(-1, 2 * page)
        table = np.frombuffer(pages, count=count, offset=page - 8 * count).reshape(-1, n)
        address = table.ctypes.data + 8 * count
        protect = ctypes.CDLL(None).mprotect
        assert protect(ctypes.c_void_p(address), ctypes.c_size_t(page), 0) == 0
        table[:] = np.sin(np.arange(count)).reshape(-1, n)
        found = []
        for threads, rows in ((1, table.copy()), (3, table)):
            coupler = double_and_fine(threads=threads)
            coupler._session.members[0].core.set_load(forms.Table(rows, 0))
            assert coupler._session.core.advance(steps, None) is None
            found.append(coupler.state("a").u)
        assert np.array_equal(*found)
        print("stepped")
        """
    )
    assert (done.returncode, done.stdout) == (0, "stepped\n"), done.stderr


def star():
    """K of eight bodies that meet in one, and the dofs of their ends and of the middle.

    Ends are coupled by the middle alone, so that the panels of the interface have gaps.
    """
    rng = np.random.default_rng(1)
    inner, end, bodies = 150, 60, 8
    n = bodies * (inner + end) + end
    middle = np.arange(n - end, n)
    K, interface = sp.eye_array(n, format="csr"), [middle]
    for i in range(bodies):
        own = np.arange(i * (inner + end), (i + 1) * (inner + end))
        dofs = np.append(own, middle)
        B = rng.normal(size=(dofs.size, dofs.size)) / np.sqrt(dofs.size)
        place = np.repeat(dofs, dofs.size), np.tile(dofs, dofs.size)
        K = K + sp.csr_array(((B @ B.T).ravel(), place), (n, n))
        interface.append(own[inner:])
    return K, np.sort(np.concatenate(interface))


def short_solid():
    """K of a solid with two large faces, and their dofs: its interface fills the factor."""
    made = pm.structures.solid(2, 10, 10, 1.0, E=4.0, nu=0.3, rho=1.0)
    faces = np.flatnonzero(np.isin(made.points[:, 0], [0.0, 2.0]))
    return made.K + sp.eye_array(made.n), np.sort(made.dofs(faces))


def held_by_its_mean(K, interface, threads):
    """A wide interface that follows a single mass on the mean, by one constraint.

    The compliance of the wide one is then most of what a fine step takes.
    """
    n = K.shape[0]
    a = pm.Subdomain(np.ones(n), K, scheme=IMPLICIT, force=np.sin(np.arange(n)), name="a")
    b = pm.Subdomain([1.0], [1.0], scheme=EXPLICIT, substeps=20, force=[1.0], name="b")
    mean = np.zeros((1, n))
    mean[:, interface] = 1.0 / interface.size
    return pm.Coupler(
        [a, b], pm.Constraint({a: mean, b: [[-1.0]]}), dt=0.2, threads=threads, coupling="pm"
    )


@contextmanager
def on_processors_of_their_own(coupler):
    """The threads of a coupler that has stepped; two on one processor would take turns."""
    before = set(os.listdir("/proc/self/task"))
    coupler.step()
    tasks = [0, *sorted(int(x) for x in set(os.listdir("/proc/self/task")) - before)]
    allowed = os.sched_getaffinity(0)
    try:
        for task, processor in zip(tasks, sorted(allowed)):
            os.sched_setaffinity(task, {processor})
        yield
    finally:
        os.sched_setaffinity(0, allowed)


@pytest.mark.gate
@LINUX
@pytest.mark.parametrize("make", [star, short_solid])
def test_jumps_are_recorded_while_another_thread_sweeps_the_same_factor(make):
    # at every fine step the jump takes the link velocity of "a", while its own thread closes and
    # opens steps of it; if they shared scratch, both would come out wrong wherever they meet. On a
    # busy machine they seldom do, hence so many steps.
    K, interface = make()
    alone = held_by_its_mean(K, interface, threads=1)
    alone.step()
    expected = alone.run(steps=60)
    for _ in range(2):
        shared = held_by_its_mean(K, interface, threads=2)
        with on_processors_of_their_own(shared):
            assert_identical(shared.run(steps=60), expected)
    a = shared._session.members[0]
    assert a.double and a.elimination.structure.panels is not None


@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
def test_a_restoring_force_is_evaluated_once_per_substep_with_threads_too():
    by_threads = {1: [], 3: []}
    for threads, times in by_threads.items():

        def recording(t, u, v, times=times):
            times.append((t, *u, *v))
            return 0.1 * u

        coupler = double_and_fine(threads=threads, of_c={"restoring": recording})
        coupler.run(steps=5)
        coupler.step(2)
    assert by_threads[3] == by_threads[1]
    assert len(by_threads[3]) == 1 + 7 * 10


def test_springs_are_recorded_alike_with_dofs_or_without():
    seen = []
    for threads in (1, 2, 3):
        n = 12
        a, b = (
            pm.Subdomain(
                np.ones(n),
                chain(n),
                scheme=scheme,
                substeps=substeps,
                restoring=[pm.Bilinear(np.arange(n), 4.0, 0.1, 0.2)],
                v0=np.ones(n),
            )
            for scheme, substeps in ((IMPLICIT, 1), (EXPLICIT, 5))
        )
        coupler = pm.Coupler(
            [a, b], pm.tie(a, [n - 1], b, [0]), dt=0.3, threads=threads, coupling="pm"
        )
        history = coupler.run(steps=20, record={a: [], b: []}, record_springs={a: None, b: None})
        seen.append([x for i in (0, 1) for x in (history[i].deformation, history[i].force)])
        assert np.abs(seen[-1][1]).max() > 0.1  # they yield
    for others in seen[1:]:
        for x, y in zip(others, seen[0]):
            np.testing.assert_array_equal(x, y)


# ---- one large explicit subdomain -------------------------------------------------------------


def solid(n, scheme=EXPLICIT, **options):
    """n x n x n nodes of three dofs, each coupled to its 26 neighbours: K has strips."""
    near = sp.diags_array([np.ones(n - 1), np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1])
    nodes = sp.kron(sp.kron(near, near), near)
    block = np.array([[1.0, 0.3, 0.2], [0.3, 1.1, 0.1], [0.2, 0.1, 0.9]])
    K = sp.csr_array(60.0 * sp.eye_array(3 * n**3) - sp.kron(nodes, block))
    load = pm.SampledForce(np.sin(np.arange(9.0)), 0.1, shape=np.ones(3 * n**3))
    return pm.Subdomain(
        np.ones(3 * n**3), K, C=np.full(3 * n**3, 0.1), scheme=scheme, force=load,
        u0=np.sin(np.arange(3.0 * n**3)), **options,
    )  # fmt: skip


@pytest.mark.gate
def test_a_large_explicit_subdomain_alone_is_split_and_bitwise_identical():
    subdomain = solid(12)  # some 4e5 entries: four ranges of 1e5 (W3)
    alone = pm.Coupler([subdomain], dt=0.05, threads=1)
    expected = alone.run(steps=20, energy=True)
    for threads in (2, 3, 4):
        coupler = pm.Coupler([subdomain], dt=0.05, threads=threads)
        assert coupler.threads == threads
        history = coupler.run(steps=20, energy=True)
        assert_identical(history, expected)
        np.testing.assert_array_equal(history.energy.balance, expected.energy.balance)
    again = pm.solve(subdomain, 0.05, 1.0, threads=2)
    np.testing.assert_array_equal(again.u, expected.subdomains[0].u)
    assert pm.Coupler([subdomain], dt=0.05, threads=64).threads < 8  # a worker for each range


@pytest.mark.gate
@pytest.mark.filterwarnings("ignore::pmalpha.ConstraintWarning")
@pytest.mark.filterwarnings("ignore::pmalpha.StabilityWarning")  # of explicit coarse subdomains
@pytest.mark.parametrize("coupling", ["pm", "gc"])
def test_a_large_explicit_subdomain_among_others_is_split_and_bitwise_identical(coupling):
    n = 8
    others = solid(n, IMPLICIT, name="a"), solid(3, substeps=2, name="c")
    b = solid(13, substeps=4, name="b")
    face = np.arange(3 * n)
    ties = [pm.tie(others[0], face, b, face), pm.tie(b, [900, 902], others[1], [0, 2])]
    histories, energies = [], []
    for threads in (1, 2, 5):
        coupler = pm.Coupler(
            [others[0], b, others[1]], ties, dt=0.1, threads=threads, coupling=coupling
        )
        assert coupler.threads == threads
        histories.append(coupler.run(steps=6))
        assert_identical(histories[-1], histories[0])
        energies.append(coupler.run(steps=4, energy=True).energy)
        for name in ("dissipated", "external", "interface", "balance"):
            one, other = (getattr(energy, name) for energy in (energies[-1], energies[0]))
            np.testing.assert_array_equal(one, other)


def test_a_large_subdomain_that_cannot_be_split_is_computed_by_one_thread():
    subdomain = solid(12, restoring=[pm.Bilinear([0], 4.0, 0.1, 0.2)])
    assert pm.Coupler([subdomain], dt=0.05, threads=2).threads == 1
    assert pm.Coupler([solid(12)], dt=0.05, threads=2, coupling="macro").threads == 1


# ---- number of threads ------------------------------------------------------------------------


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_solid_that_several_threads_factor_moves_bitwise_as_with_one(thresholds, symmetric):
    thresholds(FACTOR_SHARE=1.0)  # multiplications: every factor is shared
    solid = pm.structures.solid(5, 5, 5, 1.0, E=1.0, nu=0.3, rho=1.0, mass="consistent")
    K = solid.K if symmetric else sp.csr_array(solid.K + 0.01 * sp.triu(solid.K, k=1))
    load = np.sin(np.arange(solid.n))
    make = lambda threads: pm.Coupler(  # noqa: E731
        [pm.Subdomain(solid.M, K, scheme=IMPLICIT, force=load, symmetric=symmetric)],
        dt=0.5,
        threads=threads,
    )
    one = make(1).run(steps=5)
    for threads in (2, 3):
        assert_identical(make(threads).run(steps=5), one)


@pytest.mark.gate
@pytest.mark.parametrize("tangent", ["full", "reuse"])
@pytest.mark.parametrize("coupling", ["gc", "macro"])
def test_tangents_that_several_threads_factor_are_bitwise_those_of_one(
    thresholds, coupling, tangent
):
    thresholds(FACTOR_SHARE=1.0)  # multiplications: every factor is shared
    material = pm.structures.NeoHookean(210.0, 0.3)
    rubber = pm.structures.nonlinear_solid(4, 2, 2, 1.0, material, rho=1.0)
    v0 = np.zeros((len(rubber.points), 3))
    v0[:, 0] = 0.2 * rubber.points[:, 0]

    def moved(threads):
        a, b = (rubber.subdomain(scheme=IMPLICIT, v0=v0.ravel(), name=name) for name in "ab")
        options = dict(coupling=coupling, newton=pm.Newton(tangent=tangent), threads=threads)
        coupler = pm.Coupler([a, b], pm.tie(a, [0, 1], b, [3, 4]), dt=0.05, **options)
        first = coupler.run(steps=2)
        kept = coupler.snapshot()
        coupler.step(1)
        coupler.restore(kept)
        return first, coupler.run(steps=2)

    one = moved(1)
    for threads in (2, 4):  # one and two for each tangent
        for some, other in zip(moved(threads), one):
            assert_identical(some, other)


@pytest.mark.parametrize("threads", [0, -1])
def test_less_than_one_thread_is_refused(threads):
    with pytest.raises(ValueError, match=f"threads must be at least 1, got {threads}"):
        row_of_subdomains(threads=threads)


@pytest.mark.parametrize("threads", [True, np.True_, 2.0, "2", [2]])
def test_a_number_of_threads_that_is_no_int_is_refused(threads):
    with pytest.raises(TypeError, match="threads must be a whole number, got"):
        row_of_subdomains(threads=threads)


def test_there_are_no_more_threads_than_subdomains_and_ranges():
    assert row_of_subdomains(3, threads=100).threads == 3
    assert row_of_subdomains(3, threads=np.int64(2)).threads == 2
    assert row_of_subdomains(3, threads=1).threads == 1


def test_there_are_no_more_threads_than_processors_on_which_the_process_may_run(monkeypatch):
    monkeypatch.undo()  # the tests have as many threads as they want
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 5}, raising=False)
    assert row_of_subdomains(9, threads=10**6).threads == 2
    assert row_of_subdomains(9, threads=1).threads == 1


@pytest.mark.gate
def test_small_problems_get_one_thread_and_large_ones_all_that_help(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2}, raising=False)
    assert row_of_subdomains().threads == 1
    n = 10_000  # at least 12 n entries per substep: far above the 20 000 of a synchronization (W1)
    a, b = (pm.Subdomain(np.ones(n), chain(n), scheme=IMPLICIT) for _ in range(2))
    assert pm.Coupler([a, b], pm.tie(a, [n - 1], b, [0]), dt=0.1, coupling="pm").threads == 2
    assert pm.Coupler([a], dt=0.1).threads == 1
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5}, raising=False)
    assert pm.Coupler([a, b], pm.tie(a, [n - 1], b, [0]), dt=0.1, coupling="pm").threads == 1


def test_solve_takes_a_number_of_threads_too():
    subdomain = pm.Subdomain([1.0], [4.0], scheme=IMPLICIT, u0=[1.0])
    expected = pm.solve(subdomain, 0.1, 1.0)
    np.testing.assert_array_equal(pm.solve(subdomain, 0.1, 1.0, threads=2).u, expected.u)
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"):
        pm.solve(subdomain, 0.1, 1.0, threads=0)


@pytest.mark.gate
@pytest.mark.parametrize("coupling", ["pm", "gc", "macro"])
def test_whether_threads_are_faster_is_timed_and_changes_no_result(coupling):
    # with two processors 20 000 entries a substep promise a gain; a turn takes a millisecond
    runs = []
    for threads in (1, None):
        coupler = row_of_subdomains(2, 20_000, threads=threads, coupling=coupling, dt=0.05)
        promised = coupler.threads
        runs.append(coupler.run(steps=20, record={0: [0], 1: [0, 19_999]}))
    assert_identical(*runs)
    assert coupling == "macro" or promised == min(2, most_threads(None)[0])
    assert 1 <= coupler.threads <= promised


# ---- created by the first step, ended with the coupler ----------------------------------------


@LINUX
@pytest.mark.parametrize("threads", [1, 3])
def test_threads_are_made_by_the_first_step_and_end_with_the_coupler(threads):
    gc.collect()  # couplers of other tests
    before = tasks()
    coupler = row_of_subdomains(threads=threads)
    assert tasks() == before
    coupler.step()
    assert tasks() == before + threads - 1
    coupler.run(steps=3)
    assert tasks() == before + threads - 1
    del coupler
    assert tasks() == before


def test_a_fork_after_use_hangs_neither_the_child_nor_the_parent():
    done = waits.program(
        """
        import os
        import numpy as np
        from agreement import assert_identical
        from test_threads import row_of_subdomains

        expected = row_of_subdomains(threads=1)
        expected.step(5)
        expected = expected.run(steps=5)
        coupler = row_of_subdomains(threads=3)
        coupler.step(5)
        child = os.fork()
        assert_identical(coupler.run(steps=5), expected)  # both
        if child == 0:
            os._exit(7)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        child = os.fork()
        if child == 0:
            del coupler  # without use
            os._exit(7)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        coupler.step(5)
        """
    )
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr


class Measured:
    """An object with a property that takes as long as a function does."""

    def __init__(self, measure):
        self.measure = measure

    @cached_property
    def size(self):
        return self.measure()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_forked_off_while_a_thread_computes_a_property_computes_such_ones_too():
    inside, over = Event(), Event()

    def measure():
        inside.set()
        return over.wait(waits.LIMIT)

    with ThreadPoolExecutor(1) as pool:
        slow = Measured(measure)
        size = pool.submit(lambda: slow.size)
        assert inside.wait(waits.LIMIT)
        child = os.fork()
        if child == 0:  # a lock of the property would be taken by a thread that is not here
            signal.alarm(int(waits.LIMIT))  # which ends it
            os._exit(Measured(lambda: 7).size)
        over.set()
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        assert size.result() and slow.__dict__["size"] and Measured.size.__doc__ is None


def test_an_interpreter_ends_while_a_coupler_with_threads_lives():
    done = waits.program(
        """
        from test_threads import row_of_subdomains
        coupler = row_of_subdomains(threads=3)
        coupler.step(5)
        print("stepped")
        """
    )
    assert (done.returncode, done.stdout) == (0, "stepped\n"), done.stderr


# ---- interrupted runs -------------------------------------------------------------------------


def test_an_exception_in_a_load_is_that_of_one_thread():
    def force(t):
        if t > 0.55:
            raise LookupError("no load")
        return np.full(20, np.cos(t))

    alone, shared = (row_of_subdomains(force=force, threads=threads) for threads in (1, 3))
    for coupler in (alone, shared):
        with pytest.raises(LookupError, match="no load"):
            coupler.run(steps=20)
    assert shared.step_count == alone.step_count == 5
    assert_identical(shared.last_history, alone.last_history)


@pytest.mark.gate
def test_instability_is_that_of_one_thread():
    seen = []
    for threads in (1, 2, 4):
        with pytest.warns(pm.StabilityWarning):
            coupler = row_of_subdomains(dt=10.5, threads=threads)
        with pytest.raises(pm.InstabilityError) as caught:
            coupler.run(steps=10_000, every=10_000)
        error = caught.value
        seen.append((error.step, error.time, error.subdomain))
        assert coupler.step_count == error.step
        assert np.all(np.isfinite(coupler.state(1).u))
    assert seen[0] == seen[1] == seen[2]


def test_a_load_that_calls_its_coupler_gets_an_error_and_no_deadlock():
    coupler = None

    def force(t):
        if t > 0.2:
            coupler.step()
        return np.zeros(20)

    coupler = row_of_subdomains(force=force, threads=2)
    with pytest.raises(RuntimeError, match="being stepped"):
        coupler.run(steps=5)
