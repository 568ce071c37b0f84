"""Readers of files under a fuzzer that is guided by coverage: atheris, ``pip install atheris``.

Files that reach new code of the readers are kept in build/fuzz and changed further, those of an
earlier campaign too. Readers, good files and what counts as a fault are those of campaign_files.py;
of npz and HDF5 files one array or the header is replaced, so that their check sums are right. Each
reader has a process, and its share of the time. An input that is a fault is kept. To try it again:
``python tests/campaign_fuzz.py --reader mesh.inp --file build/fuzz/mesh.inp/faults/0-1``.
"""

import io
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
import zipfile
from collections import Counter
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from campaign import arguments

if __name__ == "__main__" and "--reader" in sys.argv:  # before what it instruments is imported
    import atheris

    with atheris.instrument_imports(include=["pmalpha", "meshio", "numpy.lib", "json"]):
        import pmalpha  # noqa: F401

import campaign_files as files

KEPT = Path(__file__).parent.parent / "build" / "fuzz"
LONGEST, MEMORY = 60, 3000  # s of one call, MB of a process


# ---- from the bytes of the fuzzer to a file, and from a good file to such bytes ------------------


@cache
def members(path):
    with zipfile.ZipFile(path) as whole:
        return [(name, whole.read(name)) for name in sorted(whole.namelist())]


def write_npz(path, good, data):
    """The good file, in which the first byte of the data names the member that the others are."""
    with zipfile.ZipFile(path, "w") as whole:
        for k, (name, content) in enumerate(members(good)):
            mine = bool(data) and data[0] % len(members(good)) == k
            whole.writestr(name, data[1:] if mine else content)


def of_npz(good):
    return [bytes([k]) + content for k, (_, content) in enumerate(members(good))]


def write_hdf5(path, good, data):
    """The file itself, or the good file with another header."""
    import h5py
    import numpy as np

    if data[:1] != b"h":
        path.write_bytes(data[1:])
        return
    content = io.BytesIO(good.read_bytes())
    with h5py.File(content, "r+") as whole:
        del whole["header"]
        whole["header"] = np.bytes_(data[1:] or b" ")
    path.write_bytes(content.getvalue())


def of_hdf5(good):
    import h5py

    with h5py.File(good, "r", locking=False) as whole:
        return [b"f" + good.read_bytes(), b"h" + whole["header"][()]]


WRITERS = {".npz": (write_npz, of_npz), ".h5": (write_hdf5, of_hdf5)}
PLAIN = (lambda path, good, data: path.write_bytes(data)), (lambda good: [good.read_bytes()])


# ---- one reader, in a process of its own ---------------------------------------------------------


class Reader:
    """Reads what the fuzzer makes, in a folder with what the good file names."""

    def __init__(self, name):
        self.name, self.good = name, Path(files.good(name).name, name)
        self.write, self.of = WRITERS.get(self.good.suffix, PLAIN)
        self.folder = tempfile.TemporaryDirectory()
        shutil.copytree(self.good.parent, self.folder.name, dirs_exist_ok=True)
        self.counts, self.faults = Counter(), set()
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)

    def fault_of(self, data):
        """The fault, or None."""
        path = Path(self.folder.name, self.name)
        self.write(path, self.good, data)
        read, checked = files.FOUND[self.name][1], self.good.suffix == ".npz"
        what, fault = files.fault_of(path, read, checked)
        self.counts[what] += 1
        return fault


def fuzz(name, seconds, seed):
    """Never returns: the fuzzer ends the process, which has printed its counts and faults."""
    reader, corpus, found = Reader(name), KEPT / name / "corpus", KEPT / name / "faults"
    for folder in (corpus, found):
        folder.mkdir(parents=True, exist_ok=True)
    for k, data in enumerate(reader.of(reader.good)):
        (corpus / f"good-{k}").write_bytes(data)

    def attempt(data):
        fault = reader.fault_of(data)
        kind = re.sub(r"[\d.]+|'.*'", "#", fault or "")
        if fault is not None and kind not in reader.faults:
            reader.faults.add(kind)
            where = found / f"{seed}-{len(reader.faults)}"
            where.write_bytes(data)
            print(f"\nfault {name}, {where}: {fault}", flush=True)
        if sum(reader.counts.values()) % 100 == 0:
            print(f"\ncounts {dict(reader.counts)}", flush=True)

    options = [f"-max_total_time={seconds:.0f}", f"-seed={seed + 1}", f"-timeout={LONGEST}"]
    options += [f"-rss_limit_mb={MEMORY}", f"-artifact_prefix={found}/", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], attempt)
    atheris.Fuzz()


def campaign(names, seconds, seed):
    """Counts by reader; AssertionError for faults."""
    counts, faults = {}, []
    for name in names:
        command = [sys.executable, __file__, "--reader", name, "--seed", str(seed)]
        command += ["--seconds", str(seconds / len(names))]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
        faults += re.findall(r"^fault .*", done.stdout, re.MULTILINE)
        shown = re.findall(r"^counts (.*)", done.stdout, re.MULTILINE)
        counts[name] = shown[-1] if shown else "fewer than a hundred"
        print(name, counts[name], flush=True)
        if done.returncode:
            faults.append(f"{name} ends with {done.returncode}: {done.stderr[-2000:]}")
    assert not faults, "\n".join(faults)
    return counts


if __name__ == "__main__":
    given = arguments(__doc__, reader=str, file=str, names=str)
    if not find_spec("atheris"):
        print("not tried: pip install atheris")
    elif given.file:
        print(Reader(given.reader).fault_of(Path(given.file).read_bytes()))
    elif given.reader:
        fuzz(given.reader, given.seconds, given.seed)
    else:
        names = given.names.split(",") if given.names else list(files.FOUND)
        campaign(names, given.seconds, given.seed)
