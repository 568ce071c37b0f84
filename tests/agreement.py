"""Comparisons of whole runs, whose failures name the quantity, the place, the time and the size.

    velocity jump at time level 3 (t = 0.15), constraint 1 is 0.004 instead of 0: 0.004 apart,
    1e-09 allowed (1e-09 of 1); 7 of 36 numbers are apart, most 0.02 at time level 34, constraint 0

The place is the first in time, which is where a wrong relation shows before others follow.
"""

import numpy as np

from pmalpha.results.quantities import arrays_of

# Quantities of one subdomain by their name in a History, and in an oracle.
MOTION = {"u": "displacement", "v": "velocity", "a": "acceleration"}
# Of quantities that differ first at one time: these are named before the motion.
FIRST = {"multiplier": 0, "velocity jump": 1, "displacement jump": 2}


def largest(*arrays):
    """The largest absolute value in all of them, 0 in none; NaN counts."""
    return max((np.max(np.abs(x), initial=0.0) for x in arrays), default=0.0)


def assert_close(got, expected, within, what, *, size=1.0, times=None, column="dof"):
    """AssertionError if a number is more than `within` times `size` from what is expected.

    Rows are time levels, at `times` if given, and columns what `column` says. `expected` is an
    array or a number. `within` has its reason where it is given, `size` is what it is relative to.
    """
    found = _difference(got, expected, within, what, size=size, times=times, column=column)
    assert found is None, found[1]


def assert_small(got, within, what, **named):
    """`assert_close` to zero: of a jump, a residual or a balance."""
    assert_close(got, 0.0, within, what, **named)


def assert_constant(got, within, what, *, times=None):
    """A number for each time level stays within a part of the first."""
    got = np.asarray(got)
    assert_close(got, got[0], within, what, size=abs(got[0]), times=times)


def assert_run_agrees(history, expected, within, *, force=0.0):
    """The run of the package against that of an oracle (`reference.Run` or alike).

    Each quantity is compared relative to the largest of its kind in all subdomains, multipliers to
    themselves and to `force`, the size of other forces, as they may be rounding. The message is of
    what differs first in time, the interface before the motion that follows from it, and names
    what else differs and what agrees.
    """
    found, agreeing = [], []

    def compare(got, wanted, what, **named):
        difference = _difference(got, wanted, within, what, **named)
        if difference is None:
            agreeing.append(what)
        else:
            time, message = difference
            found.append((time, FIRST.get(what, len(FIRST)), message, what))

    scale = {x: largest(*(_of(s, x) for s in expected.subdomains)) for x in MOTION}
    for i, (ours, theirs) in enumerate(zip(history.subdomains, expected.subdomains, strict=True)):
        np.testing.assert_array_equal(ours.t, theirs.t)
        for x, word in MOTION.items():
            what = f"{word} of subdomain {i}"
            compare(getattr(ours, x), _of(theirs, x), what, size=scale[x], times=ours.t)
    times = history.multiplier_times
    np.testing.assert_array_equal(times, expected.multiplier_times)
    at = {"times": times, "column": "constraint"}
    # the velocities of the two sides agree to rounding in both programs
    for program, run in (("", history), (" of the oracle", expected)):
        compare(run.velocity_jump, 0.0, f"velocity jump{program}", size=scale["v"], **at)
    size = max(largest(expected.multipliers), force)
    compare(history.multipliers, expected.multipliers, "multiplier", size=size, **at)
    at["times"] = history.macro_times
    jumps = history.displacement_jump, expected.displacement_jump
    compare(*jumps, "displacement jump", size=scale["u"], **at)
    assert not found, _told(found, agreeing)


def assert_motion_agrees(history, expected, within):
    """The motion of each subdomain alone, each quantity relative to the largest of its own."""
    for i, (ours, theirs) in enumerate(zip(history.subdomains, expected.subdomains, strict=True)):
        for x, word in MOTION.items():
            got, wanted = getattr(ours, x), _of(theirs, x)
            what = f"{word} of subdomain {i}"
            assert_close(got, wanted, within, what, size=largest(wanted), times=ours.t)


def assert_order(errors, low, high, names=("the motion",)):
    """The order of each of the named errors, whose rows are of runs with steps halved in turn."""
    errors = np.asarray(errors, dtype=float).reshape(len(errors), -1)
    orders = np.log2(errors[:-1] / errors[1:])
    for k, i in np.argwhere(~((low < orders) & (orders < high))):
        raise AssertionError(
            f"{names[i]} has order {orders[k, i]:.3g}, not between {low:g} and {high:g}: its error "
            f"is {errors[k, i]:.3g}, and {errors[k + 1, i]:.3g} with half the step"
        )


def assert_identical(history, other):
    """Two histories to the last bit, minus zero and NaN included; shapes and types too."""
    assert [name for name, _ in history.keys] == [name for name, _ in other.keys]
    for i, (x, y) in enumerate(zip(history.subdomains, other.subdomains, strict=True)):
        assert (x is None) == (y is None), f"subdomain {i} is recorded in one of the two"
        if x is not None:
            assert_same_arrays(arrays_of(x), arrays_of(y), f" of subdomain {i}")
            assert_same_arrays(x.outputs, y.outputs, f" of the outputs of subdomain {i}")
    assert_same_arrays(arrays_of(history), arrays_of(other), "")
    assert bool(history.energy) == bool(other.energy)
    if history.energy:
        assert_same_arrays(history.energy.arrays(), other.energy.arrays(), " of the energy")


def assert_same_arrays(arrays, others, of):
    assert arrays.keys() == others.keys(), f"other arrays{of}"
    for name, x in arrays.items():
        assert_same_bits(x, others[name], f"{name}{of}")


def assert_same_levels(coupler, other):
    """The present of two couplers to the last bit: time levels in the core, and multipliers."""
    pairs = zip(coupler._session.members, other._session.members, strict=True)
    for i, (x, y) in enumerate(pairs):
        assert_same_arrays(x.core.levels(), y.core.levels(), f" of subdomain {i}")
    assert_same_bits(coupler.multipliers, other.multipliers, "multipliers")


def assert_same_bits(x, y, what="array"):
    x, y = np.asarray(x), np.asarray(y)
    assert (x.shape, x.dtype) == (y.shape, y.dtype), f"{what} has another shape or type"
    if x.tobytes() != y.tobytes():
        assert_close(x, y, 0.0, what)
        raise AssertionError(f"{what} differs in the sign of a zero, or in NaN")


def _told(found, agreeing):
    (_, _, message, _), *others = sorted(found)
    others = [f"{what} from {time:g} s" for time, _, _, what in others]
    return (
        f"{message}\n  then apart: {', '.join(others) or 'nothing else'}"
        f"\n  agreeing: {', '.join(agreeing) or 'nothing'}"
    )


def _of(subdomain, x):
    """An oracle names the acceleration at a time level w."""
    return getattr(subdomain, "w" if x == "a" else x)


def _difference(got, expected, within, what, *, size=1.0, times=None, column="dof"):
    """None, or the time (the row where no times are given) of the first difference and its text."""
    got, expected = np.asarray(got), np.asarray(expected)
    if expected.ndim and got.shape != expected.shape:
        return -np.inf, f"{what} has the shape {got.shape}, not {expected.shape}"
    expected = np.broadcast_to(expected, got.shape)
    off = np.abs(got - expected)
    wrong = ~(off <= within * size)  # NaN is wrong
    if not wrong.any():
        return None

    def place(k):
        at = ""
        if got.ndim:
            at = f" at time level {k[0]}" + ("" if times is None else f" (t = {times[k[0]]:.6g})")
        return at + "".join(f", {column} {i}" for i in k[1:])

    first = np.unravel_index(np.argmax(wrong), wrong.shape)
    most = np.unravel_index(np.argmax(np.where(np.isnan(off), np.inf, off)), off.shape)
    row = first[0] if got.ndim else 0
    return (
        float(row if times is None else times[row]),
        f"{what}{place(first)} is {got[first]:.9g} instead of {expected[first]:.9g}: "
        f"{off[first]:.2g} apart, {within * size:.2g} allowed ({within:.2g} of {size:.3g}); "
        f"{wrong.sum()} of {wrong.size} numbers are apart, most {off[most]:.2g}{place(most)}",
    )
