"""Readers of files under a fuzzer that is guided by coverage: atheris, ``pip install atheris``.

Files that reach new code of the readers are kept in build/fuzz and changed further, those of an
earlier campaign too. Readers, good files and what counts as a fault are those of campaign_files.py.
Bytes are changed by the fuzzer; most of the changes keep the structure of the file: in npz and HDF5
files one array, attribute or header is replaced, so that check sums are right, in text a number or
word, or a line. Each reader has a process, and its share of the time; ``--names`` has some of them,
``--meshes meshio`` reads meshes by it. An input that is a fault is kept. To try it again:
``python tests/campaign_fuzz.py --reader mesh.inp --file build/fuzz/mesh.inp/faults/0-1``.
"""

import io
import os
import re
import shutil
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections import Counter
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from campaign import arguments

if __name__ == "__main__" and find_spec("atheris"):
    import atheris

    # of the readers, and of the libraries that read for them
    guided = [name for name in ("pmalpha", "json", "meshio", "meshlane") if find_spec(name)]
    with atheris.instrument_imports(include=guided):
        for name in guided:
            __import__(name)

import campaign_files as files
import numpy as np
from entries import one
from odd_values import COUNTS, NUMBERS, odd

KEPT = Path(__file__).parent.parent / "build" / "fuzz"
LONGEST, MEMORY = 60, 3000  # s of one call, MB of a process
SIGNATURE = b"\x89HDF"


# ---- changes that keep the structure of a file ---------------------------------------------------


def changed_npz(rng, data, changed):
    """One member changed, with its check sum: its bytes, or another array or header."""
    content = io.BytesIO(data)
    if rng.random() < 0.5:
        files.forged_npz(rng, content)
        return content.getvalue()
    with zipfile.ZipFile(content) as whole:
        members = {name: whole.read(name) for name in whole.namelist()}
    name = one(rng, *members)
    members[name] = changed(members[name])
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as whole:
        for name, own in members.items():
            whole.writestr(name, own)
    return content.getvalue()


def changed_hdf5(rng, data, changed):
    """One dataset, group or attribute is another, has another name, or none."""
    import h5py

    content = io.BytesIO(data)
    with h5py.File(content, "r+") as whole:
        if "header" in whole and rng.random() < 0.4:
            _change_header(rng, whole, changed)
        else:
            _change_item(rng, whole, changed)
    return content.getvalue()


def _change_header(rng, whole, changed):
    text = np.asarray(whole["header"][()]).tobytes()
    if rng.random() < 0.5:
        header = files.json.loads(text)
        text = files.json.dumps(files.odd_json(rng, header)).encode()
    else:
        text = changed(text)
    del whole["header"]
    whole["header"] = np.bytes_(text or b" ")


def _change_item(rng, whole, changed):
    import h5py

    names = []
    whole.visit(names.append)
    place = whole[one(rng, *names)]
    attributes = [*place.attrs] if rng.random() < 0.4 else []
    if attributes:
        key = one(rng, *attributes)
        place.attrs[key] = _odd_content(rng, place.attrs[key], changed)
        return
    name, kind = place.name, int(rng.integers(5))
    if kind == 0:
        del whole[name]
    elif kind == 1:
        whole.move(name, one(rng, name + "0", *(f"{other}/x" for other in names)))
    elif kind == 2:
        other = whole[one(rng, *names)]
        del whole[name]
        whole[name] = other
    elif isinstance(place, h5py.Dataset):
        value = place[()]
        how = one(rng, {}, {}, {"chunks": True, "compression": "gzip"}, {"maxshape": True})
        new = np.atleast_1d(_odd_content(rng, value, changed))
        if how.pop("maxshape", False):
            how |= {"maxshape": new.ndim * (None,), "chunks": True}
        del whole[name]
        whole.create_dataset(name, data=new, **how)
    else:
        place.create_group("x")


def _odd_content(rng, value, changed):
    """Other numbers, shapes and types, or other bytes of the same type."""
    x = np.atleast_1d(np.asarray(value))
    if x.dtype.kind in "biuf" and rng.random() < 0.6:
        return files.odd_plain_array(rng, x)
    if x.dtype.hasobject:
        return np.bytes_(changed(str(value).encode()) or b" ")
    return np.frombuffer(changed(x.tobytes()).ljust(x.nbytes, b"\0")[: x.nbytes], x.dtype)


def changed_text(rng, data, changed):
    """A number or a word is another, or a line is lost, twice, or elsewhere."""
    lines = data.splitlines(keepends=True)
    kind, i, k = int(rng.integers(6)), *rng.integers(len(lines), size=2).tolist()
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines.insert(k, lines[i])
    elif kind == 2:
        lines[i], lines[k] = lines[k], lines[i]
    else:
        tokens = re.findall(rb"[\w.+-]+", data)
        old, new = one(rng, *tokens), one(rng, *tokens)
        if kind > 3:
            new = str(odd(rng, one(rng, *COUNTS, *NUMBERS))).encode("utf-8", "replace")
        places = [m.span() for m in re.finditer(re.escape(old), data)]
        begin, end = one(rng, *places)
        return data[:begin] + new[:1000] + data[end:]
    return b"".join(lines)


def changed_file(data, most, seed, good):
    """Another input; half of them of the good file, since most that are kept are damaged."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.5:
        data = good

    def changed(content):
        return atheris.Mutate(content, max(len(content) + 64, 128))

    if rng.random() < 0.75:
        how = changed_text
        if data[:4] == SIGNATURE:
            how = changed_hdf5
        elif data[:2] == b"PK":
            how = changed_npz
        try:
            return how(rng, data, changed)[:most]
        except Exception:  # of a file that is damaged, or a change that its library refuses
            pass
    return atheris.Mutate(data, most)


# ---- one reader, in a process of its own ---------------------------------------------------------


class Reader:
    """Reads what the fuzzer makes, in a folder with what the good file names."""

    def __init__(self, name):
        self.name, self.good = name, Path(files.good(name).name, name)
        self.folder = tempfile.TemporaryDirectory()
        shutil.copytree(self.good.parent, self.folder.name, dirs_exist_ok=True)
        self.counts, self.faults = Counter(), set()
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)

    def fault_of(self, data):
        """The fault, or None."""
        path = Path(self.folder.name, self.name)
        path.write_bytes(data)
        read, checked = files.FOUND[self.name][1], self.good.suffix == ".npz"
        what, fault = files.fault_of(path, read, checked)
        self.counts[what] += 1
        return fault


def fuzz(name, seconds, seed):
    """Never returns: the fuzzer ends the process, which has printed its counts and faults."""
    reader, corpus, found = Reader(name), KEPT / name / "corpus", KEPT / name / "faults"
    for folder in (corpus, found):
        folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(reader.good, corpus / "good")

    def attempt(data):
        fault = reader.fault_of(data)
        kind = re.sub(r"[\d.]+|'.*'", "#", fault or "")
        if fault is not None and kind not in reader.faults:
            reader.faults.add(kind)
            where = found / f"{seed}-{len(reader.faults)}"
            where.write_bytes(data)
            print(f"\nfault {name}, {where}: {fault}", flush=True)
        if sum(reader.counts.values()) % 10 == 0:
            print(f"\ncounts {dict(reader.counts)}", flush=True)

    options = [f"-max_total_time={seconds:.0f}", f"-seed={seed + 1}", f"-timeout={LONGEST}"]
    options += [f"-rss_limit_mb={MEMORY}", f"-artifact_prefix={found}/", "-verbosity=0"]
    # changes that are added up, or cut off at the longest length so far, leave no file readable
    options += ["-mutate_depth=2", "-len_control=0"]
    options += [f"-max_len={4 * reader.good.stat().st_size + 4096}"]
    change = partial(changed_file, good=reader.good.read_bytes())
    atheris.Setup([sys.argv[0], *options, str(corpus)], attempt, custom_mutator=change)
    atheris.Fuzz()


def campaign(names, seconds, seed, meshes):
    """Counts by reader; AssertionError for faults."""
    counts, faults = {}, []
    for name in names:
        files.good(name)
    if meshes == "meshio":
        sys.modules["meshlane"] = None
    for k, name in enumerate(names):  # some may be there more than once
        status, shown = of_child(fuzz, name, seconds / len(names), seed + k)
        faults += re.findall(r"^fault .*", shown, re.MULTILINE)
        found = re.findall(r"^counts (.*)", shown, re.MULTILINE)
        counts[name] = found[-1] if found else "fewer than ten"
        print(name, counts[name], flush=True)
        if status:
            faults.append(f"{name} ends with {status}: {shown[-2000:]}")
    assert not faults, "\n".join(faults)
    return counts


def of_child(call, *arguments):
    """The status of a forked process, since what is guided takes long to import, and its output."""
    with tempfile.TemporaryFile("w+", errors="replace") as out:
        child = os.fork()
        if not child:
            try:
                for descriptor in (1, 2):
                    os.dup2(out.fileno(), descriptor)
                call(*arguments)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        return status, out.read()


if __name__ == "__main__":
    given = arguments(__doc__, reader=str, file=str, names=str, meshes=str)
    if given.file:
        print(Reader(given.reader).fault_of(Path(given.file).read_bytes()))
    elif not find_spec("atheris"):
        print("not tried: pip install atheris")
    else:
        names = given.names.split(",") if given.names else list(files.FOUND)
        campaign(names, given.seconds, given.seed, given.meshes)
