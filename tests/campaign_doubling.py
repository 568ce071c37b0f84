"""Files of which one thing is repeated: twice the size takes at most 2.5 times the time and memory.

Each reading is in a process of its own, whose time on a processor and whose memory are counted.
Small files are made larger until they take long enough to be compared.
"""

import contextlib
import multiprocessing
import os
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

from campaign import arguments

import pmalpha as pm

MATERIAL = {"E": 1.0, "nu": 0.3, "rho": 1.0}
NODES = "*NODE\n1,0.,0.\n2,1.,0.\n3,1.,1.\n4,0.,1.\n"
CELL = "*ELEMENT,TYPE=CPS4,ELSET=all\n1,1,2,3,4\n"
PART = f"*PART,NAME=p\n{NODES}{CELL}*END PART\n*ASSEMBLY,NAME=a\n"
PLATE = NODES + CELL
MANY = "*NODE\n1,0.,0.\n1001,1.,0.\n*NGEN,NSET=line\n1,1001,1\n2001,0.,1.\n"


def strip(n):
    """n squares in a row."""
    nodes = "".join(f"{2 * i + 1},{i}.,0.\n{2 * i + 2},{i}.,1.\n" for i in range(n + 1))
    cells = (f"{i + 1},{2 * i + 1},{2 * i + 3},{2 * i + 4},{2 * i + 2}\n" for i in range(n))
    return f"*NODE\n{nodes}*ELEMENT,TYPE=CPS4,ELSET=all\n{''.join(cells)}"


def alternating(n):
    """Blocks of two types in turn, and a set of each element."""
    lines = [strip(n).partition("*ELEMENT")[0]]
    for i in range(n):
        a = 2 * i + 1  # its first node
        lines.append(f"*ELEMENT,TYPE={'CPS4' if i % 2 else 'CPS4R'},ELSET=e{i}\n")
        lines.append(f"{i + 1},{a},{a + 2},{a + 3},{a + 1}\n")
    return "".join(lines)


def bars(n):
    cards = [f"GRID,{i},,{i}.,0.,0.\n" for i in range(1, n + 2)]
    return (
        "BEGIN BULK\n"
        + "".join(cards)
        + "".join(f"CROD,{i},{i},{i},{i + 1}\n" for i in range(1, n + 1))
    )


def chain_of_systems(n):
    first = "CORD2R,1,0,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n"
    rest = (f"CORD2R,{i},{i - 1},0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n" for i in range(2, n))
    rod = f"GRID,1,{n - 1},0.,0.,0.\nGRID,2,0,1.,0.,0.\nCROD,1,1,1,2\n"
    return f"BEGIN BULK\n{first}{''.join(rest)}{rod}"


def gmsh(n):
    """Triangles of n physical groups in the format of gmsh."""
    nodes = "".join(f"{i + 1} {i} {i % 2} 0\n" for i in range(n + 2))
    cells = "".join(f"{i + 1} 2 2 {i + 1} 1 {i + 1} {i + 2} {i + 3}\n" for i in range(n))
    return (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{n + 2}\n{nodes}$EndNodes\n"
        f"$Elements\n{n}\n{cells}$EndElements\n"
    )


def at2(head="", samples=""):
    return f"PEER\nA\nUNITS OF G\n{head}NPTS= 1, DT= .01\n .1\n{samples}"


def user_elements(n, nodes=2):
    """n elements, of which the first has a matrix."""
    listed = ", ".join(str(i + 1) for i in range(nodes))
    head = f"*USER ELEMENT, NODES={nodes}, LINEAR\n** ELEMENT NODES\n** {listed}\n1\n"
    count = nodes * (nodes + 1) // 2
    return head + "*MATRIX,TYPE=STIFFNESS\n" + "1.,\n" * count + (n - 1) * head


def diagonal_matrix(n):
    """In Harwell-Boeing format."""
    head = f"diagonal\n{3 * n + 1} {n + 1} {n} {n} 0\nRSA {n} {n} {n} 0\n(1I14) (1I14) (1D25.15)\n"
    pointers, rows = (listed("#\n")(k).replace("0\n", "", 1) for k in (n + 2, n + 1))
    return head + pointers + rows + "1.5d+00\n" * n


def listed(text):
    """n times this text with the number of each in place of #."""
    return lambda n: "".join(text.replace("#", str(i)) for i in range(n))


def after(begin, text):
    return lambda n: begin + listed(text)(n)


INSTANCE = "*INSTANCE,NAME=i#,PART=p\n#,0,0\n*END INSTANCE\n"
COLUMN = "DMIG*   KAAX        {0:>16}{1:>16}\n*       {0:>16}{1:>16}  4.000000000D+00\n"
DMIG = "DMIG    KAAX           0       6       2       0\n"
COSMOS = "1 accel pts, approx 1 secs, units="
ROWS = "\n0.0 1.0\n0.1 2.0\n"

# name: (suffix, how many repetitions to begin with, content of n of them)
CASES = {
    "instances": (".inp", 200, after(PART, INSTANCE)),
    "elements": (".inp", 500, strip),
    "blocks of two types": (".inp", 200, alternating),
    "parts": (".inp", 200, listed(f"*PART,NAME=p#\n{PLATE}*END PART\n")),
    "sets": (".inp", 200, after(PLATE, "*ELSET,ELSET=s#\n1\n")),
    "sets in a set": (".inp", 200, after(PLATE, "*ELSET,ELSET=s#\nall,1\n*ELSET,ELSET=x\ns#\n")),
    "generated sets": (".inp", 100, after(MANY + PLATE, "*NSET,NSET=s#,GENERATE\n1,1001,1\n")),
    "lines of a generated set": (
        ".inp",
        100,
        after(MANY + PLATE + "*NSET,NSET=s,GENERATE\n", "1,1000000000,999999\n"),
    ),
    "names of a set": (".inp", 500, after(PLATE + "*ELSET,ELSET=s\n", "all,\n")),
    "generated nodes": (".inp", 100, after(MANY + PLATE + "*NGEN\n", "1,1001\n")),
    "generated elements": (".inp", 300, lambda n: strip(n) + after("*ELGEN\n", "1,1\n")(n)),
    "unknown keywords": (".inp", 1000, after(PLATE, "*WORD#\n1,2\n")),
    "options that go on": (".inp", 1000, after(PLATE + "*STEP,\n", "NAME=x,\n")),
    "numbers of a row": (".inp", 2000, after(PLATE + "*NSET,NSET=s\n", "1,")),
    "cards": (".bdf", 300, bars),
    "continuations": (".bdf", 500, after(bars(3) + "SPOINT,1\n", ",1,2,3\n")),
    "systems of systems": (".bdf", 20, chain_of_systems),
    "an included name": (".bdf", 1000, after("BEGIN BULK\nINCLUDE 'x\n", "y\n")),
    "physical groups": (".msh", 300, gmsh),
    "counts of PEER": (".at2", 2000, lambda n: at2("NPTS=1," * n + "\n")),
    "blanks of PEER": (".at2", 2000, lambda n: at2("1" + " " * n + "\nNPTS, DT\n")),
    "labels of PEER": (".at2", 2000, lambda n: at2("NPTS" + " " * n + "\n")),
    "samples": (".at2", 2000, lambda n: at2(samples=" .1E-03\n" * n)),
    "digits": (".at2", 2000, lambda n: at2(samples="1" * n + "\n")),
    "blanks of COSMOS": (".v1", 200, lambda n: COSMOS + " " * n + "\n"),
    "units of columns": (".txt", 1000, lambda n: "(cm/s" * n + ROWS),
    "steps of columns": (".txt", 1000, lambda n: "NPTS " * n + ROWS),
    "columns": (".txt", 1000, lambda n: "".join(f"{0.01 * i:.2f} 1.0\n" for i in range(n))),
    "entries": (".mtx", 1000, lambda n: "".join(f"{i + 1} {i + 1} 1.0\n" for i in range(n))),
    "entries of Harwell-Boeing": (".matrix", 1000, diagonal_matrix),
    "user elements": (".mtx", 200, user_elements),
    "nodes of a user element": (".mtx", 50, lambda n: user_elements(2, n)),
    "columns of DMIG": (
        ".pch",
        300,
        lambda n: DMIG + "".join(COLUMN.format(i + 1, 1) for i in range(n)),
    ),
}
READERS = {
    ".at2": pm.readers.read_at2,
    ".v1": pm.readers.read_record,
    ".txt": pm.readers.read_record,
    ".mtx": pm.readers.read_abaqus,
    ".matrix": pm.readers.read_harwell_boeing,
    ".pch": pm.readers.read_dmig,
}
DOCUMENTED = (ValueError, OSError, MemoryError, UserWarning)
# A reading that takes less than this is not compared: seconds of a processor, and bytes
SHORTEST, SMALLEST = 0.15, 24 << 20
MOST, MOST_BYTES, LONGEST = 2.5, 2 << 20, 120


def structure(path):
    return pm.structures.from_mesh(path, MATERIAL)


def costs(path, found):
    """In a process: what a reading comes to, its seconds, and by how much the memory grew."""
    read = READERS.get(path.suffix, structure)
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    before, begin = peak(), time.process_time()
    try:
        read(path)
        word = "read"
    except DOCUMENTED:
        word = "refused"
    except BaseException as error:
        word = repr(error)[:200]
    found.send((word, time.process_time() - begin, peak() - before))
    os._exit(0)


def read_once(path, content):
    path.write_text(content)
    with contextlib.suppress(*DOCUMENTED):
        READERS.get(path.suffix, structure)(path)


def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


def measured(folder, name, n):
    suffix, _, content = CASES[name]
    path = Path(folder, f"case{suffix}")
    path.write_text(content(n))
    mine, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=costs, args=(path, theirs))
    process.start()
    theirs.close()
    try:
        found = mine.recv() if mine.poll(LONGEST) else ("takes too long", LONGEST, 0)
    except EOFError:
        found = "ended", 0.0, 0
    process.kill()
    process.join()
    return path.stat().st_size, *found


def attempt(folder, name, counts):
    """Twice and twice again, until a reading is long enough to compare it with that of twice."""
    n = CASES[name][1]
    read_once(Path(folder, f"small{CASES[name][0]}"), CASES[name][2](3))  # imports what it needs
    before = None
    while True:
        size, word, seconds, memory = measured(folder, name, n)
        assert word in ("read", "refused"), f"{name}, {size} bytes: {word}"
        if before is not None:
            long, large = before[1] >= SHORTEST, before[2] >= SMALLEST
            # the better of two, where something else has had the processor
            most = MOST * size / (2 * before[0])
            if long and seconds > most * before[1]:
                seconds = min(seconds, measured(folder, name, n)[2])
            line = f"{name}, {before[0]} and {size} bytes: {before[1]:.2f} and {seconds:.2f} s"
            line += f", {before[2] >> 20} and {memory >> 20} MB"
            assert not long or seconds <= most * before[1], line
            assert not large or memory <= most * before[2], line
            if long or size > MOST_BYTES:
                counts["compared" if long else "short"] += 1
                return
        before = size, seconds, memory
        n *= 2


def campaign(names, most=None):
    global MOST_BYTES
    MOST_BYTES = most or MOST_BYTES
    counts = Counter()
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        for name in names:
            attempt(folder, name, counts)
    return counts


if __name__ == "__main__":
    words = arguments(__doc__, only=str)
    print(dict(campaign([x for x in CASES if not words.only or words.only in x])))
