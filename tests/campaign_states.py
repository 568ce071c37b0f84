"""Checkpoints in which one number is another one: a coupler refuses them by name, or goes on.

After a refusal the coupler is as it was. After a load it makes steps, which may end in an
exception; then a good state is restored, from which the motion is bitwise that of before. To be run
with an extension under the sanitizers too, from the folder that `make sanitized` makes.
"""

import json
import tempfile
import warnings
from functools import cache
from pathlib import Path

import numpy as np
from campaign import arguments, seeds, tried
from counted import COUNTING, counting
from frozen_couplers import COUPLINGS, bouncing, frame, iterated

import pmalpha as pm

NUMBERS = (0.0, 1.0, 2.0, 3.0, 13.0, -1.0, 0.5, 1e9, -1e9, 2.0**31, 2.0**53, 2.0**63, 2.0**64)
NUMBERS += (1e300, -1e300, 1e-300, -0.0, np.nan, np.inf, -np.inf)
COUNTS = (0, 1, -1, 5, 2**31, 2**53, 2**62, 2**63, 2**70, -(2**63), 0.5, 1e300)
MADE = {c: lambda c=c: frame(c) for c in COUPLINGS}
MADE |= {f"{c}, springs": lambda c=c: frame(c, "bilinear") for c in ("gc", "pm", "macro")}
MADE |= {
    "contact": bouncing,
    "iterated": lambda: iterated("gc"),
    "shooting": lambda: iterated("macro"),
    "kept tangents": lambda: iterated("gc", newton=pm.Newton(tangent="reuse")),
}
MADE |= {kind: lambda make=make: counting(make) for kind, (make, _) in COUNTING.items()}


def motion(coupler):
    names = [s.name for s in coupler.subdomains]
    return np.concatenate([getattr(coupler.state(s), x) for s in names for x in "uva"])


@cache
def good(kind):
    """A coupler, its checkpoint, a snapshot, and the motion there and two steps later."""
    coupler = MADE[kind]()
    coupler.step(5)
    with tempfile.TemporaryDirectory() as folder:
        coupler.save(Path(folder, "good.npz"))
        with np.load(Path(folder, "good.npz")) as file:
            content = dict(file)
    here, begin = coupler.snapshot(), motion(coupler)
    coupler.step(2)
    return coupler, content, here, begin, motion(coupler)


def changed_header(rng, text):
    """Its macro step, or a number of its description, is another one."""
    header = json.loads(text)
    places = [header]
    while isinstance(places[-1], dict | list):
        keys = list(places[-1]) if isinstance(places[-1], dict) else range(len(places[-1]))
        if not len(keys):
            return text
        key = keys[int(rng.integers(len(keys)))]
        if not isinstance(places[-1][key], dict | list):
            places[-1][key] = COUNTS[int(rng.integers(len(COUNTS)))]
            break
        places.append(places[-1][key])
    return json.dumps(header)


def write_changed(rng, path, content):
    """The content with one number changed; which array it is of."""
    arrays = {name: x for name, x in content.items() if x.dtype == float and x.size}
    name = ["header", *arrays][int(rng.integers(1 + len(arrays)))]
    if name == "header":
        x = np.array(changed_header(rng, content["header"].item()))
    else:
        x = content[name].copy()
        k = int(rng.integers(x.size))
        old = x.flat[k]
        others = (*NUMBERS, old + 1.0, old - 1.0, -old, 1e6 * old)
        x.flat[k] = others[int(rng.integers(len(others)))]
    with path.open("wb") as file:
        np.savez(file, **content | {name: x})
    return name


def attempt(seed, counts):
    rng = np.random.default_rng([seed, 58])
    coupler, content, here, begin, end = good(list(MADE)[seed % len(MADE)])
    coupler.restore(here)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "changed.npz")
        name = write_changed(rng, path, content)
        try:
            coupler.load(path)
        except ValueError as error:
            counts["refused"] += 1
            assert "changed.npz" in str(error) or "is singular" in str(error), (name, error)
            np.testing.assert_array_equal(motion(coupler), begin)
        else:
            counts["loaded"] += 1
            try:
                coupler.step(2)
                counts["stepped"] += 1
            except (pm.PmalphaError, ValueError):  # of a step beyond what is counted
                counts["ended by an exception"] += 1
    coupler.restore(here)
    np.testing.assert_array_equal(motion(coupler), begin)
    coupler.step(2)
    np.testing.assert_array_equal(motion(coupler), end)


def campaign(numbers):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tried(attempt, numbers)


if __name__ == "__main__":
    words = arguments(__doc__)
    print(dict(campaign(seeds(words.seed, words.seconds))))
