"""The public functions with odd arguments: each call works or raises a documented exception.

The message of a TypeError or ValueError names an argument; no warning of NumPy or SciPy comes
out; a result holds no NaN; a long call ends by Ctrl-C. The calls are made in a child process: one
that crashes or hangs is found by the seed it printed last, and another goes on.
"""

import ast
import faulthandler
import inspect
import os
import re
import resource
import signal
import subprocess
import sys
import traceback
import warnings
from collections import Counter
from time import monotonic

import entries
import numpy as np
import scipy.sparse as sp
from campaign import arguments, seeds
from odd_values import odd

import pmalpha as pm
from pmalpha.results.energy import Energy

DOCUMENTED = (TypeError, ValueError, KeyError, IndexError, pm.PmalphaError, MemoryError, OSError)
LONGEST, HANGS = 5, 60  # s, of one call: then Ctrl-C, then the end of the process
MOST_MEMORY = 6 << 30


def spoiled(rng, values):
    """The arguments with one or two of them odd; their names."""
    names = rng.permutation(list(values))[: 1 + int(rng.random() < 0.25)]
    return values | {name: odd(rng, values[name]) for name in names}, [str(name) for name in names]


def arrays_in(x, depth=5):
    """The arrays of numbers in a result."""
    if isinstance(x, np.ndarray):
        yield x
    elif isinstance(x, sp.sparray | sp.spmatrix):
        yield x.tocoo().data
    elif isinstance(x, float):
        yield np.array(x)
    elif depth and isinstance(x, list | tuple):
        for y in x:
            yield from arrays_in(y, depth - 1)
    elif depth and isinstance(x, dict):
        yield from arrays_in(list(x.values()), depth - 1)
    elif isinstance(x, Energy):  # beyond the range of numbers where the motion is within it
        return
    elif depth and type(x).__module__.startswith("pmalpha") and hasattr(x, "__dict__"):
        yield from arrays_in(list(vars(x).values()), depth - 1)


def has_nan(x):
    return any(np.isnan(a).any() for a in arrays_in(x) if a.dtype.kind in "fc")


def names_argument(function, names, error):
    """Whether the message contains a word of the signature or one of these names."""
    try:
        names = {*map(str, names), "L", *inspect.signature(function).parameters}
    except ValueError:
        names = set(names)
    if isinstance(error, KeyError) or "subdomain" in str(error):  # of a key of a dict
        return True
    words = set(re.findall(r"\w+", str(error)))
    return bool(names & words) or any(name.replace("_", " ") in str(error) for name in names)


def from_within(error):
    """Whether the exception comes from a library below the package, or from its inside."""
    last = traceback.extract_tb(error.__traceback__)[-1].filename
    return "pmalpha" not in last and "tests" not in last


def fault_of(function, values, names, use):
    """(what came out, the fault or None) of one call."""
    used = False
    try:
        result = function(**values)
        used = True
        if use is not None:
            result = use(result)
    except KeyboardInterrupt:
        return "long", None
    except DOCUMENTED as error:
        kind = type(error).__name__
        if isinstance(error, pm.PmalphaError | MemoryError):
            return kind, None
        if from_within(error):
            return kind, f"{kind} from a library: {error}"
        if not used and not names_argument(function, names, error):
            return kind, f"the message names no argument: {error}"
        return kind, None
    except Exception as error:
        return type(error).__name__, f"{type(error).__name__}: {error}"
    return ("NaN", "NaN in the result") if has_nan(result) else ("works", None)


def attempt(seed, counts):
    """One call; the fault that was found, or None."""
    rng = np.random.default_rng([seed, 11])
    entry = entries.ENTRIES[int(rng.integers(len(entries.ENTRIES)))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        function, values, use = entry(rng)
        values, names = spoiled(rng, values)
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Glyph")  # of matplotlib, for odd text
        for category in vars(pm).values():
            if isinstance(category, type) and issubclass(category, Warning):
                warnings.simplefilter("ignore", category)
        signal.setitimer(signal.ITIMER_REAL, LONGEST)
        what, fault = fault_of(function, values, names, use)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    counts["calls"] += 1
    counts[what] += 1
    if fault is None:
        return None
    shown = {name: brief(values[name]) for name in names}
    return f"{entry.__name__}, {getattr(function, '__name__', function)}, {shown}: {fault}"


def brief(x):
    text = f"{type(x).__name__} {x!r}"
    return text if len(text) < 300 else text[:300] + "..."


def run_in_this_process(first, seconds, most, attempt):
    """Prints each seed before its call, and the faults."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if "libasan" not in os.environ.get("LD_PRELOAD", ""):
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    counts = Counter()
    for seed in seeds(first, seconds):
        if seed == first + most:
            break
        print(f"\rseed {seed}", end="", flush=True)
        faulthandler.dump_traceback_later(HANGS, exit=True)
        fault = attempt(seed, counts)
        if fault is not None:
            counts["faults"] += 1
            print(f"\rseed {seed}: {fault}", flush=True)
    faulthandler.cancel_dump_traceback_later()
    print("\r" + repr(dict(counts.most_common())))


def child(first, seconds, most, script):
    """The counts, the faults, and the seed at which the process ended, of a child process."""
    command = [sys.executable, "-X", "faulthandler", script, "--child", str(most)]
    command += ["--seed", str(first), "--seconds", str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True)
    lines = done.stdout.replace("\r", "\n").splitlines()
    faults = [line for line in lines if re.match(r"seed \d+:", line)]
    last = [int(line.split()[1]) for line in lines if re.fullmatch(r"seed \d+", line)][-1]
    if done.returncode == 0:
        return Counter(ast.literal_eval(lines[-1])), faults, last
    assert "Traceback (most" not in done.stderr, done.stderr  # of this script itself
    how = f"seed {last} ends the process, {done.returncode}: {done.stderr[-2000:]}"
    return Counter(ends=1), [*faults, how], last


def campaign(first=0, seconds=60.0, most=2**31, script=__file__):
    """Counts of what was tried; AssertionError for faults."""
    end, seed, counts, faults = monotonic() + seconds, first, Counter(), []
    while monotonic() < end and seed < first + most:
        found, new, last = child(seed, end - monotonic(), first + most - seed, script)
        counts, faults, seed = counts + found, faults + new, last + 1
    assert not faults, "\n".join([*faults, str(dict(counts))])
    return dict(counts.most_common())


def main(what, attempt, script):
    """What a script does: the campaign, or the attempts of one child."""
    given = arguments(what, child=int)
    if given.child:
        run_in_this_process(given.seed, given.seconds, given.child, attempt)
    else:
        print(campaign(given.seed, given.seconds, script=script))


if __name__ == "__main__":
    main(__doc__, attempt, __file__)
