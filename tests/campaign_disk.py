"""Files that two programs write, replace, cut off or leave behind, full disks and power failures.

Each trial makes one file and lets something happen to it: another run takes its name, a reader
opens it while it is replaced, it is truncated, the disk is full, a signal comes, the power fails
(`Power`: a layer that forgets pages that were not synchronised). What may come out is a result of
its own run alone, or an exception that is documented; what else happens is counted as "wrong".
"""

import json
import os
import random
import resource
import shutil
import signal
import stat
import tempfile
import threading
import warnings
import zipfile
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import waits
from campaign import arguments, seeds

import pmalpha as pm

SHORT, LONG = 30, 4000  # macro steps
FAST = 1e5  # periods of microseconds
MEMORY = 1 << 30  # bytes that no small file may take


def coupler(size=1.0, **options):
    """A coupler whose motion is `size` times that of another."""
    s = pm.Subdomain(
        np.ones(3), np.ones(3), scheme=pm.Newmark(), u0=np.full(3, size), name="s", **options
    )
    return pm.Coupler([s], dt=0.1)


def program(function, *arguments):
    """What a function of this file returns in a process of its own, or the signal that ends it."""
    call = f"{function.__name__}(*json.loads({json.dumps(arguments)!r}))"
    code = f"import json, campaign_disk\nprint('=' + json.dumps(campaign_disk.{call}))"
    done = waits.program(code, survives=False)
    if done.returncode < 0:
        return f"wrong: {signal.Signals(-done.returncode).name}"
    last = done.stdout.splitlines()[-1:]
    assert done.returncode == 0 and last and last[0].startswith("="), done.stderr
    return json.loads(last[0][1:])


def whose(history, steps=None):
    """The size of the run a History is of, 0 if rows of several are in it."""
    u = np.array(history["s"].u)
    found = set(np.round(u[0], 6)) if len(u) else {0.0}
    size = found.pop() if len(found) == 1 else 0.0
    if size <= 0.0 or (steps is not None and len(u) != steps + 1):
        return 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = coupler(size).run(steps=len(u) - 1)["s"].u
    return size if np.array_equal(u, expected) else 0.0


# ---- two runs with one name ----------------------------------------------------------------------


def one_of_two(path, options, size, steps, gate, report):
    """A run that begins with the other; one byte reports what came of it."""
    os.read(gate, 1)
    try:
        history = coupler(size).run(steps=steps, record_to=path, **options)
        found = whose(history, steps)
        code = b"o" if found == size else b"m" if found == 0.0 else b"a"
    except OSError as error:
        code = b"e" if isinstance(error, FileExistsError) else b"r"
    except ValueError:  # append: of another state
        code = b"r"
    except BaseException:
        code = b"x"
    os.write(report, code)
    os._exit(0)


def rivals(path, options, first, second):
    """Two processes that start together: what came of each."""
    warnings.simplefilter("ignore")
    coupler().run(steps=1, record_to=f"{path}.before.h5")  # what it imports
    gate, opened = os.pipe()
    reports = []
    for size, steps in (first, second):
        read, write = os.pipe()
        if os.fork() == 0:
            one_of_two(path, options, size, steps, gate, write)
        os.close(write)
        reports.append(read)
    os.write(opened, b"go")
    codes = [os.read(read, 1).decode() for read in reports]
    for _ in codes:
        os.wait()
    return codes


def two_runs(rng, folder):
    """With one `record_to`: each returns its own rows or is refused; without options one is."""
    mode = ("new", "append", "overwrite")[int(rng.integers(3))]
    options = {} if mode == "new" else {mode: True}
    path, steps = str(folder / "run.h5"), [int(rng.choice([SHORT, LONG])) for _ in range(2)]
    if mode == "append" and rng.random() < 0.5:
        coupler().run(steps=0, record_to=path)
    codes = program(
        rivals, path, options, (1.0, steps[0]), (1.0 if mode == "append" else 2.0, steps[1])
    )
    if isinstance(codes, str):
        return f"{mode}, {codes}"
    for code, what in {"m": "mixed", "a": "of another", "x": "another exception"}.items():
        if code in codes:
            return f"{mode}, wrong: {what}"
    if codes == ["o", "o"] and mode != "overwrite":
        return f"{mode}, wrong: both"
    return f"{mode}, {'both in turn' if codes == ['o', 'o'] else 'one refused'}"


# ---- a file that is replaced while it is read ----------------------------------------------------


def replaced_for_ever(path, copies):
    while True:
        for copy in copies:
            os.link(copy, f"{path}.next")
            os.replace(f"{path}.next", path)


def loads_of_replaced(path, copies, loads):
    """Loads, while another process replaces the file all the time."""
    warnings.simplefilter("ignore")
    found, child = Counter(), os.fork()
    if child == 0:
        replaced_for_ever(path, copies)
    try:
        for _ in range(loads):
            try:
                found["loaded" if whose(pm.History.load(path)) else "wrong: mixed"] += 1
            except Exception as error:
                found[f"wrong: {type(error).__name__}"] += 1
    finally:
        os.kill(child, signal.SIGKILL)
        os.wait()
    return found


def replaced_while_loaded(rng, folder):
    """`History.load` returns one of the two runs."""
    suffix = ".h5" if rng.random() < 0.7 else ".npz"
    copies = [str(folder / f"{k}{suffix}") for k in range(2)]
    for k, steps in enumerate((SHORT, 60)):
        if suffix == ".h5":
            coupler(1.0 + k).run(steps=steps, record_to=copies[k])
        else:
            coupler(1.0 + k).run(steps=steps).save(copies[k])
    path = folder / f"run{suffix}"
    shutil.copy(copies[0], path)
    return Counter(program(loads_of_replaced, str(path), copies, 100))


# ---- a file that is truncated or replaced --------------------------------------------------------


def spoil(path, how):
    if how == "truncated":
        os.truncate(path, os.path.getsize(path) // 2)
    elif how == "emptied":
        os.truncate(path, 0)
    else:
        Path(f"{path}.next").write_bytes(b"something else")
        os.replace(f"{path}.next", path)


def use_spoiled(path, how, steps):
    """A History whose file is truncated after the run."""
    warnings.simplefilter("ignore")
    history = coupler().run(steps=steps, record_to=path)
    spoil(path, how)
    try:
        return "its rows" if whose(history, steps) else "wrong: other rows"
    except OSError:
        return "OSError"


def spoiled_history(rng, folder):
    how = ("truncated", "emptied", "replaced")[int(rng.integers(3))]
    steps = int(rng.choice([SHORT, LONG]))
    return f"{how}, {program(use_spoiled, str(folder / 'run.h5'), how, steps)}"


def run_spoiled(path, how, at):
    """A run whose file is truncated or replaced while it goes on."""
    warnings.simplefilter("ignore")
    from pmalpha.results import recording

    recording.FILED_BYTES = 4000.0  # some thirty macro steps at a time
    made = []

    def force(t):
        if t > 0.1 * at and not made:
            made.append(t)
            spoil(path, how)
        return np.zeros(3)

    c = coupler(force=force)
    try:
        c.run(steps=3 * at, record_to=path)
    except OSError:
        history = c.last_history
        if history is None:
            return "wrong: no rows"
        if how == "replaced" and round(history.macro_times[0], 9) != 0.0:
            return "wrong: rows are missing"
        rows = len(history.macro_times) - 1
        begin = round(history.macro_times[0] / 0.1)
        reaches = begin + rows == c.step_count
        return "OSError" if reaches else "wrong: the last rows are missing"
    except BaseException as error:
        return f"wrong: {type(error).__name__}"
    return "wrong: silent"


def spoiled_run(rng, folder):
    how = ("truncated", "emptied", "replaced")[int(rng.integers(3))]
    return (
        f"{how}, {program(run_spoiled, str(folder / 'run.h5'), how, int(rng.integers(100, 300)))}"
    )


def paced(specimen):
    s = pm.Subdomain(
        [1.0], None, scheme=pm.CentralDifference(), restoring=specimen, v0=[1.0], name="s"
    )
    return pm.Coupler([s], dt=0.01, coupling="gc")


def monitor_spoiled(path, how):
    """A paced run whose monitor is truncated by its specimen."""
    warnings.simplefilter("ignore")
    calls = []

    def specimen(t, u, v):
        calls.append(t)
        if len(calls) == 30:
            waits.until(lambda: Path(path).exists())
            spoil(path, how)
        return 4.0 * u

    c = paced(specimen)
    c.monitor(path)
    history = c.run_paced(1.0, rate=FAST, on_late="continue")  # it waits for the monitor
    return "goes on" if history.macro_times.size == 101 else "wrong: ended"


def spoiled_monitor(rng, folder):
    how = ("truncated", "emptied", "replaced")[int(rng.integers(3))]
    target = folder / "elsewhere"
    target.write_bytes(b"kept")
    found = program(monitor_spoiled, str(folder / "live"), how)
    return f"{how}, {found if target.read_bytes() == b'kept' else 'wrong: another file written'}"


# ---- disks that are full -------------------------------------------------------------------------


def full_after(size):
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def study_of(path, cases, each):
    study = pm.Study(coupler, steps=3, result=lambda h: {"u": np.tile(h["s"].u, (each, 1))})
    return study.run([{}] * cases, save_to=path)


def study_on_full(path, size, cases, each):
    warnings.simplefilter("ignore")
    full_after(size)
    try:
        study_of(path, cases, each)
    except OSError:
        return "OSError"
    return "fits"


def full_study(rng, folder):
    """`Study.run(save_to=)` ends with OSError."""
    size = int(10 ** rng.uniform(2.0, 6.5))
    return program(study_on_full, str(folder / "study.h5"), size, 20, int(10 ** rng.uniform(0, 3)))


def run_on_full(path, size):
    warnings.simplefilter("ignore")
    from pmalpha.results import recording

    recording.FILED_BYTES = 4000.0
    full_after(size)
    c = coupler()
    try:
        c.run(steps=LONG, record_to=path)
    except OSError:
        if not c.step_count:
            return "OSError before the first step"
        history = c.last_history
        whole = history is not None and len(history.macro_times) == c.step_count + 1
        return "OSError" if whole and whose(history) else "wrong: rows are missing"
    return "fits"


def full_run(rng, folder):
    """The History after the error has all steps that were taken."""
    return program(run_on_full, str(folder / "run.h5"), int(10 ** rng.uniform(4.0, 5.7)))


def paced_on_full(path, allowed):
    """A paced run whose file is not written any more: how many steps came after that."""
    warnings.simplefilter("ignore")
    from pmalpha.results import recording, ring

    recording.FILED_BYTES, ring.INTERVAL = 4e4, 1e-3
    pwrite, failed = os.pwrite, []

    def full(descriptor, data, offset):
        nonlocal allowed
        allowed -= len(data)
        if allowed < 0:
            failed.append(allowed)
            raise OSError(28, "No space left on device")
        return pwrite(descriptor, data, offset)

    def specimen(t, u, v):
        return 4.0 * u

    c = paced(specimen)
    os.pwrite = full
    try:
        c.run_paced(60.0, rate=100.0, on_late="continue", record_to=path)
    except OSError:
        if not failed or c.step_count == 0:
            return "OSError before the first step"
        if c.step_count == 6000:
            return "wrong: at the end"
        history = c.last_history
        whole = history is not None and len(history.macro_times) == c.step_count + 1
        return "OSError at once" if whole else "wrong: rows are missing"
    return "fits"


def full_paced(rng, folder):
    return program(paced_on_full, str(folder / "run.h5"), int(10 ** rng.uniform(4.0, 5.5)))


# ---- kills and Ctrl-C ----------------------------------------------------------------------------


def killed_after(seconds, call):
    """A child process that is killed after a time of its own work."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        with suppress(BaseException):
            call()
        os._exit(0)
    os.waitpid(child, 0)


def studies_killed(folder, times):
    """Studies killed before their first result: which files they leave, and the next start."""
    import h5py

    warnings.simplefilter("ignore")
    study_of(os.path.join(folder, "first.h5"), 1, 1)  # imports what it needs
    found = Counter()

    def hangs():
        threading.Event().wait()

    def begin(path):
        def made():
            while True:  # the first result never comes
                pass

        pm.Study(made, steps=1, result=lambda h: {"u": h["s"].u}).run([{}], save_to=path)

    for k, seconds in enumerate(times):
        path = os.path.join(folder, f"{k}.h5")
        killed_after(seconds, partial(begin, path))
        if os.path.exists(path):
            try:
                with h5py.File(path):
                    found["a file"] += 1
            except OSError:
                found["wrong: no file of HDF5"] += 1
        else:
            found["no file"] += 1
        try:
            study_of(path, 1, 1)
        except OSError:
            found["wrong: the next start is blocked"] += 1
    return found


def killed_study(rng, folder):
    return Counter(program(studies_killed, str(folder), rng.uniform(1e-3, 8e-3, 8).tolist()))


def saves_killed(folder, times):
    """Checkpoints and histories killed while they are written: what is left beside them.

    A file that replaces another has a hidden name for an instant, when it is whole.
    """
    warnings.simplefilter("ignore")
    n = 50_000
    s = pm.Subdomain(np.ones(n), np.ones(n), scheme=pm.Newmark(), name="s")
    c = pm.Coupler([s], dt=0.1)
    history = c.run(steps=1)
    for k, seconds in enumerate(times):
        name = os.path.join(folder, ("state", "run.npz", "run.h5")[k % 3])
        killed_after(seconds, partial((c if k % 3 == 0 else history).save, name))
    files = list(Path(folder).iterdir())
    left = [x for x in files if x.name not in ("state", "run.npz", "run.h5")]
    sizes = {x.stat().st_size for x in files if x not in left}
    found = Counter({"kills": len(times)})
    for x in left:
        is_whole = x.suffix == ".part" and x.stat().st_size in sizes
        found["whole, with a hidden name" if is_whole else "wrong: files left"] += 1
    return found


def killed_save(rng, folder):
    return Counter(program(saves_killed, str(folder), rng.uniform(1e-3, 2e-2, 9).tolist()))


def saves_interrupted(folder, times):
    """Ctrl-C in `save`: KeyboardInterrupt, and the file before or the new one."""
    warnings.simplefilter("ignore")
    c, found = coupler(), Counter()
    history = c.run(steps=SHORT)
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    for k, seconds in enumerate(times):
        name = Path(folder, "state" if k % 2 else "run.npz")
        try:
            signal.setitimer(signal.ITIMER_REAL, seconds)
            (c if k % 2 else history).save(name)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            for _ in range(3):
                pass
            found["saved"] += 1
        except KeyboardInterrupt:
            found["KeyboardInterrupt"] += 1
        except BaseException as error:
            found[f"wrong: {type(error).__name__}"] += 1
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    if set(os.listdir(folder)) - {"state", "run.npz"}:
        found["wrong: files left"] += 1
    return found


def interrupted_save(rng, folder):
    return Counter(program(saves_interrupted, str(folder), rng.uniform(1e-5, 3e-3, 60).tolist()))


# ---- files of strangers --------------------------------------------------------------------------


def big_monitor(path):
    header = {"format": "pmalpha monitor", "rows": 1_400_000_000, "columns": 0, "period": 1.0}
    header |= {"t0": 0.0, "h": 1.0, "dofs": {}}
    found = []
    for version in (1, 2):
        text = json.dumps(header | {"version": version}).encode().ljust((1 << 14) - 16)
        Path(path).write_bytes(text + 2 * np.int64(1_400_000_000).tobytes())
        with suppress(ValueError, OSError):
            found.append(pm.rig.read_monitor(path))


def fifo(path):
    os.mkfifo(path)
    signal.alarm(20)
    pm.rig.read_monitor(path)


def big_chunks(path, filters):
    """An HDF5 file whose array is not there, or is packed."""
    import h5py

    coupler().run(steps=3, record_to=path)
    with h5py.File(path, "r+") as file:
        shape = (4, 150_000_000 if filters != "zeros" else 100_000_000)
        del file["s/u"]
        x = file.create_dataset("s/u", shape, "f8", chunks=(4, 1_000_000), **FILTERS[filters])
        if filters == "zeros":
            x[:, :1_000_000] = 0.0
    np.array(pm.History.load(path)["s"].u)


FILTERS = {
    "never written": {"compression": "gzip"},
    "shuffled": {"shuffle": True},
    "zeros": {"compression": "gzip"},
}


def overlapping(path):
    """An npz file whose members are one after another in its directory, not in the file."""
    with zipfile.ZipFile(path, "w") as file:
        with file.open("x0.npy", "w") as member:
            np.lib.format.write_array(member, np.zeros(500_000))
        with file.open("header.npy", "w") as member:
            text = json.dumps({"format": "pmalpha History", "version": 1})
            np.lib.format.write_array(member, np.array(text))
        first = file.infolist()[0]
        for k in range(1, 400):
            copy = zipfile.ZipInfo(f"x{k}.npy")
            for name in ("CRC", "compress_size", "file_size", "header_offset", "compress_type"):
                setattr(copy, name, getattr(first, name))
            file.filelist.append(copy)
            file.NameToInfo[copy.filename] = copy
        file._didModify = True
    # a name is compared with that beside the data: all have names of five letters
    data = Path(path).read_bytes()
    Path(path).write_bytes(data)
    pm.History.load(path)


def doubling(path):
    """Files that include the next one twice, thirty-one times."""
    folder = Path(path).parent
    for k in range(31):
        line = f"*INCLUDE, INPUT=f{k + 1}.inp\n"
        Path(folder, f"f{k}.inp").write_text(2 * line)
    Path(folder, "f31.inp").write_text("*NSET, NSET=a\n")
    signal.alarm(20)
    pm.structures.from_mesh(folder / "f0.inp", {"E": 1.0, "nu": 0.3, "rho": 1.0})


STRANGE = {
    "monitor": big_monitor,
    "fifo": fifo,
    **{f"HDF5, {name}": partial(big_chunks, filters=name) for name in FILTERS},
    "npz": overlapping,
    "INCLUDE": doubling,
}


def read_strange(path, name):
    warnings.simplefilter("ignore")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    coupler().run(steps=1, record_to=f"{path}.before.h5")
    resource.setrlimit(resource.RLIMIT_AS, 2 * (used + MEMORY,))
    try:
        STRANGE[name](path)
    except (ValueError, OSError) as error:
        return f"refused {type(error).__name__}"
    except MemoryError as error:
        return "wrong: MemoryError" if "needs about" not in str(error) else "refused MemoryError"
    return "read"


def strange_file(rng, folder):
    """A small file of a stranger takes no large memory, and no pipe is waited for."""
    name = list(STRANGE)[int(rng.integers(len(STRANGE)))]
    path = folder / ("run.npz" if name == "npz" else "run.h5" if "HDF5" in name else "run")
    return f"{name}, {program(read_strange, str(path), name)}"


# ---- modes and memory ----------------------------------------------------------------------------


def mode_of_old(rng, folder):
    """A file that only its owner reads is one after the next save too."""
    path = folder / ("state", "run.npz", "run.h5")[int(rng.integers(3))]
    c = coupler()
    save = c.save if path.name == "state" else c.run(steps=1).save
    save(path)
    path.chmod(0o600)
    save(path)
    mode = stat.S_IMODE(path.stat().st_mode)
    return "kept" if mode == 0o600 else f"wrong: {mode:o}"


def load_with_little(path, spare):
    warnings.simplefilter("ignore")
    coupler().run(steps=1, record_to=f"{path}.before.h5")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, 2 * (used + spare,))
    try:
        pm.History.load(path)
    except MemoryError:
        return "MemoryError"
    except ValueError:
        return "wrong: damaged"
    return "loaded"


def little_memory(rng, folder):
    """A whole file is not called damaged where memory does not suffice to map it."""
    path = folder / "run.h5"
    s = pm.Subdomain(np.ones(1000), np.ones(1000), scheme=pm.Newmark(), name="s")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pm.Coupler([s], dt=0.1).run(steps=5000, record_to=path)  # 120 MB
    return program(load_with_little, str(path), int(rng.uniform(1e6, 1e8)))


# ---- power ---------------------------------------------------------------------------------------

PAGE = 4096


class Power:
    """The system calls that write, and what is on the disk after a power failure.

    What was written before the last call that synchronises is there; of what came later each page
    is there or not, in any order.
    """

    NAMES = ("pwrite", "ftruncate", "fsync", "fdatasync")

    def __init__(self):
        self.log = []  # (kind, offset, bytes)

    def __enter__(self):
        self.before = {name: getattr(os, name) for name in self.NAMES}

        def pwrite(descriptor, data, offset):
            self.log.append(("write", offset, bytes(data)))
            return self.before["pwrite"](descriptor, data, offset)

        def ftruncate(descriptor, size):
            self.log.append(("size", size, b""))
            return self.before["ftruncate"](descriptor, size)

        def synchronised(name, descriptor):
            self.log.append(("sync", 0, b""))
            return self.before[name](descriptor)

        os.pwrite, os.ftruncate = pwrite, ftruncate
        os.fsync, os.fdatasync = partial(synchronised, "fsync"), partial(synchronised, "fdatasync")
        return self

    def __exit__(self, *exception):
        for name, function in self.before.items():
            setattr(os, name, function)

    def image(self, rng):
        """The file after a failure at a random instant after the first call that synchronises."""
        syncs = [k for k, (kind, *_) in enumerate(self.log) if kind == "sync"]
        end = int(rng.integers(syncs[0] + 1, len(self.log) + 1))
        safe = max(k for k in syncs if k < end)
        disk, lost = bytearray(), float(rng.choice([0.1, 0.5, 0.9]))
        there = {}  # whether a page that was written since then is there
        for k, (kind, offset, data) in enumerate(self.log[:end]):
            if kind == "size":
                disk = disk[:offset].ljust(offset, b"\0")
            for at in range(0, len(data), 1):
                page = (offset + at) // PAGE
                if k < safe or there.setdefault(page, rng.random() > lost):
                    disk[offset + at] = data[at]
        return bytes(disk)


def power_failure(rng, folder):
    """A file of a run has all rows that it counts."""
    from pmalpha.results import array_file, recording

    before = recording.FILED_BYTES, array_file.SYNC_SECONDS
    recording.FILED_BYTES, array_file.SYNC_SECONDS = 2000.0, 0.0  # as of a run of many seconds
    try:
        with Power() as power:
            coupler(2.0).run(steps=120, record_to=folder / "run.h5")
    finally:
        recording.FILED_BYTES, array_file.SYNC_SECONDS = before
    path, found = folder / "left.h5", Counter()
    for _ in range(10):
        path.write_bytes(power.image(rng))
        try:
            found[
                "whole" if whose(pm.History.load(path)) else "wrong: rows that are not there"
            ] += 1
        except ValueError:
            found["wrong: refused"] += 1
    return found


TRIALS = (
    two_runs,
    replaced_while_loaded,
    spoiled_history,
    spoiled_run,
    spoiled_monitor,
    full_study,
    full_run,
    full_paced,
    killed_study,
    killed_save,
    interrupted_save,
    strange_file,
    mode_of_old,
    little_memory,
    power_failure,
)


def attempt(seed, counts, trials=TRIALS):
    """One trial, the seed's."""
    trial, rng = trials[seed % len(trials)], np.random.default_rng([seed, 17])
    random.seed(seed)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = trial(rng, Path(folder))
    for what, times in ({found: 1} if isinstance(found, str) else found).items():
        counts[f"{trial.__name__}: {what}"] += times


def faults(counts):
    return {what: times for what, times in counts.items() if "wrong" in what}


if __name__ == "__main__":
    given, counts = arguments(__doc__, only=str), Counter()
    chosen = [trial for trial in TRIALS if given.only in (None, trial.__name__)]
    for seed in seeds(given.seed, given.seconds):
        attempt(seed, counts, chosen)
    for what, times in sorted(counts.items()):
        print(f"{times:6} {what}")
    assert not faults(counts)
