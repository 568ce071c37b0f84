"""The arrays in which a run records, and the History made of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from .._checks import MOST, flag, whole_number
from ..files import Held
from ..memory import fits, require
from ..problem.dofs import dof_list, names_at
from ..problem.restoring import devices_of
from ..problem.subdomain import Subdomain
from ..setup.member import Member
from ..setup.rows import CoreRows
from .contact import layouts
from .energy import ENERGIES, ENERGY_FIELDS, Energy, Loads, added, balanced, check_ground
from .history import History, SubdomainHistory
from .history_file import HistoryFile, output_array, row_count
from .outputs import Outputs, chosen_outputs
from .quantities import (
    IN_SUBDOMAIN,
    NO_ENERGY,
    OF_CONSTRAINTS,
    OF_INTERFACE,
    OF_SUBDOMAIN,
    WORKS,
    ContactRows,
    CoreRecord,
    CoreSelection,
    InternalRows,
    OutputRows,
    RigRows,
    SpringRows,
    by_index,
    chosen_springs,
    recorded_columns,
)
from .stored import EarlierRows, contents_of, fields_of, old_file, target
from .times import Clock

# A run that is written to a file: bytes kept in memory, and seconds between two writes, about.
FILED_BYTES, FILED_SECONDS = 16e6, 0.3
OF_RIG = tuple(IN_SUBDOMAIN["commands"])
COUNTS = {name for name, x in OF_SUBDOMAIN.items() if x.is_count}


@dataclass(frozen=True)
class Wanted:
    """What a run records, and where: arguments of `Coupler.run`, of `run_each` for one case."""

    record: Mapping[Any, Any] | None = None
    every: int | None = None
    energy: bool = False
    record_springs: Mapping[Any, Any] | None = None
    outputs: Mapping[Any, Any] | None = None
    rig: bool = False
    record_to: Any = None
    append: bool = False
    overwrite: bool = False

    def __post_init__(self) -> None:
        flag(self.rig, "rig")

    @property
    def is_everything(self) -> bool:
        """Whether all dofs are recorded, and nothing else."""
        chosen = self.record, self.record_springs, self.outputs
        return not self.energy and not self.rig and all(x is None for x in chosen)

    def to(self, path: Any) -> Wanted:
        """The same in another file; None is none."""
        return self if path is self.record_to else replace(self, record_to=path)

    def in_memory(self) -> Wanted:
        """The same without a file."""
        return replace(self, record_to=None, append=False, overwrite=False)


class Sizes(NamedTuple):
    """The sizes of the arrays of a run: their rows by time levels per macro step, their numbers,
    with those that a History adds, and where each is in one block."""

    rows: dict[int, int]
    numbers: float
    places: list[tuple[slice, tuple[int, int]]]


class Recorded:
    """What runs record of the subdomains and of the interface, whatever their length.

    rows: the constraints as the core has them.
    fine: interface problems per macro step.
    """

    def __init__(
        self,
        members: Sequence[Member],
        keys: Sequence[tuple[str, Subdomain]],
        rows: CoreRows,
        *,
        fine: int,
        wanted: Wanted,
    ):
        self.members, self.keys, self.core_rows, self.fine = members, tuple(keys), rows, fine
        self.contacts = rows.contacts
        self.outputs = chosen_outputs(wanted.outputs, self.keys)
        self.dofs = chosen_dofs(wanted.record, self.keys, self.outputs)
        self.springs = chosen_springs(wanted.record_springs, self.keys, self.dofs)
        if wanted.rig:
            self.dofs = with_rigs(self.dofs, self.keys)
        self.columns = [
            recorded_columns(*arguments, wanted.rig)
            for arguments in zip(members, self.dofs, self.springs)
        ]
        self.interface_columns = self._interface_columns()
        self.interface = {
            name: (self.levels_of(name), self.interface_columns[x.columns])
            for name, x in OF_INTERFACE.items()
            if x.made is None and x.columns in self.interface_columns
        }
        self.substeps = np.array([[member.substeps for member in members]], dtype=np.int64)
        self.has_energy = bool(wanted.energy)
        self.energy_columns = len(members) * len(ENERGIES) if wanted.energy else 0
        self.positions = [
            None if dofs is None else member.position[dofs]
            for member, dofs in zip(members, self.dofs)
        ]
        self.weights = [
            () if output is None else output.in_order(member.position)
            for member, output in zip(members, self.outputs)
        ]
        self.numbers = Counter({1: 2 * self.energy_columns})  # also as a History has them
        for member, columns, output in zip(members, self.columns, self.outputs):
            self.numbers[member.substeps] += sum(columns.values()) + (
                0 if output is None else output.rows
            )
        for levels, count in self.interface.values():
            self.numbers[levels] += count
        self._last: tuple[tuple[int, int | None], Sizes] | None = None

    def sizes(self, steps: int, every: int | None) -> Sizes:
        """The sizes with this number of macro steps in memory: those of the last run, if equal."""
        if self._last is None or self._last[0] != (steps, every):
            self._last = (steps, every), self._sizes(steps, every)
        return self._last[1]

    def _sizes(self, steps: int, every: int | None) -> Sizes:
        rows = {levels: rows_of(steps, every, levels) for levels in self.numbers}
        substeps = [member.substeps for member in self.members]
        shapes = [(levels, x) for levels, of in zip(substeps, self.columns) for x in of.values()]
        outputs = zip(substeps, self.outputs)
        shapes += [(levels, output.rows) for levels, output in outputs if output is not None]
        shapes += [*self.interface.values(), (1, self.energy_columns)]
        places, used = [], 0
        for levels, columns in shapes:
            begin, used = used, used + rows[levels] * columns
            places.append((slice(begin, used), (rows[levels], columns)))
        numbers = sum(rows[levels] * count for levels, count in self.numbers.items())
        return Sizes(rows, numbers, places)

    def _interface_columns(self) -> dict[str, int]:
        """Numbers of columns by what they are; contacts are recorded where there are any."""
        counts = {"": 1, "constraints": self.core_rows.p, "subdomains": len(self.members)}
        if self.contacts is not None:
            counts |= {"contact rows": self.contacts.rows, "contacts": self.contacts.count}
        return counts

    def check_ground(self, loads: Sequence[Loads]) -> None:
        """ValueError for absolute outputs of a subdomain whose loads have no ground motion."""
        for load, outputs, (name, _) in zip(loads, self.outputs, self.keys):
            if outputs is not None and outputs.ground:
                check_ground(load, name)

    def levels_of(self, name: str) -> int:
        """Time levels per macro step of an array of the interface."""
        return 1 if OF_INTERFACE[name].axis == "macro" else self.fine


class Recording:
    """The record of a run from macro step `begin` to at most `end`.

    coupling: under "mean" the multipliers belong to the middle of a macro step, not to its end.
    conserved: {"dual", "energy"} or None, what `Energy.conserved` is, from `conserved_quantity`.
    loads: those of each subdomain, of which absolute outputs have the motion of the ground.
    problem: its description, which files have, so that no run of another one continues them.
    constraint_rows: the number of rows of each constraint.
    common: of an interval, the arrays that are equal in several quantities and in all records that
        `again` makes; `shares`: cases have these themselves, read-only.
    unshared: the same of the History of a run, which has the first itself, and copies of it.
    """

    def __init__(
        self,
        of: Recorded,
        *,
        coupling: str,
        begin: int,
        end: int,
        clock: Clock,
        every: int | None,
        conserved: str | None = None,
        loads: Sequence[Loads] = (),
        problem: Mapping[str, Any] | None = None,
        constraint_rows: tuple[int, ...] = (),
    ):
        self.loads, self.problem, self.shares = loads, problem, False
        self.constraint_rows = constraint_rows
        self.common: dict[tuple[int, int], dict[tuple[str, int], np.ndarray]] = {}
        self.unshared: dict[tuple[str, int], np.ndarray] = {}
        self.of, self.begin, self.end, self.clock = of, begin, end, clock
        self.every = None if every is None else whole_number(every, "every", low=1)
        self.coupling, self.conserved = coupling, conserved
        self.steps_in_memory = self._steps_in_memory()
        advice = "choose dofs with record= or fewer time levels with every="
        self.sizes = of.sizes(self.steps_in_memory, self.every)
        self.numbers = self.sizes.numbers
        require(8.0 * self.numbers, "the History", advice)
        self.block = np.empty(self.sizes.places[-1][0].stop)
        self._make_arrays()

    def again(self, loads: Sequence[Loads], memory: Recording | np.ndarray) -> Recording:
        """The same of a case with other loads, in a block of this size or a record that is done."""
        self.of.check_ground(loads)
        other = copy(memory if isinstance(memory, Recording) else self)
        other.loads, other.common, other.shares = loads, self.common, True
        if isinstance(memory, np.ndarray):
            other.block = memory
            other._make_arrays()
        return other

    def _make_arrays(self) -> None:
        """All of one block: in pieces the memory would be returned to the system when a History is
        released, and the next run would wait for new pages."""
        of, block = self.of, self.block
        views = iter([block[place].reshape(shape) for place, shape in self.sizes.places])
        self.arrays = [{name: next(views) for name in columns} for columns in of.columns]
        self.output_values = [None if x is None else next(views) for x in of.outputs]
        self.interface = dict(zip(of.interface, views))
        self.energy = next(views)
        self.in_core = self._in_core()

    @property
    def numbers_kept(self) -> float:
        """Numbers that the History keeps in memory."""
        return self.numbers

    @property
    def continues(self) -> bool:
        """Whether the rows of another run come before."""
        return False

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()

    def release(self) -> None:
        """What is outside of memory is given back; the record ends."""

    def pauses(self) -> Iterator[int]:
        """Macro steps at which the run pauses for a call of `keep`."""
        yield self.end

    def keep(self, end: int) -> None:
        """Called when the core has recorded all rows up to macro step `end`."""

    def _steps_in_memory(self) -> int:
        """Maximum number of macro steps between two pauses."""
        return self.end - self.begin

    def _numbers(self, rows: Callable[[int], float]) -> float:
        """Numbers in all arrays; ``rows(levels)`` is the number of rows of an array."""
        return sum(rows(levels) * count for levels, count in self.of.numbers.items())

    def rows(self, levels: int, end: int) -> int:
        """Number of rows up to macro step `end`, with `levels` time levels per macro step."""
        return row_count(self.begin, end, self.every or 0, levels)

    def times(self, levels: int, end: int) -> np.ndarray:
        """The times of these rows, equation (T1)."""
        return self._once("times", levels, end, lambda: self._times(levels, end))

    def _once(self, name: str, levels: int, end: int, make: Callable[[], np.ndarray]) -> np.ndarray:
        """An array that is made once for an interval, or a copy of it."""
        arrays = self._shared(end) if self.shares else self.unshared
        array = arrays.get((name, levels))
        if array is None:
            array = arrays[name, levels] = make()
            array.flags.writeable = not self.shares
            return array
        return array if self.shares else array.copy()

    def _shared(self, end: int) -> dict[tuple[str, int], np.ndarray]:
        if (self.begin, end) not in self.common:
            self.common.clear()
        return self.common.setdefault((self.begin, end), {})

    def _times(self, levels: int, end: int) -> np.ndarray:
        clock = self.clock
        if self.every is None:
            first, last = clock.count(self.begin) * levels, clock.count(end) * levels
            return clock.levels(first, last, levels)
        later = np.arange(self.begin // self.every + 1, end // self.every + 1) * self.every
        done = np.concatenate([[self.begin], later]) - clock.origin
        return clock.t0 + done * clock.dt

    def multiplier_times(self, end: int) -> np.ndarray:
        return self._once("multiplier times", 1, end, lambda: self._multiplier_times(end))

    def _multiplier_times(self, end: int) -> np.ndarray:
        times = self._times(self.of.fine, end)
        if self.coupling == "mean":
            times -= 0.5 * self.clock.dt
            if self.begin == self.clock.origin:  # the middle of the macro step before
                times[0] = self.clock.t0 - 0.5 * self.clock.before
        return times

    def substeps(self, end: int) -> np.ndarray:
        """The substeps of each subdomain at each macro time level."""
        rows = self.rows(1, end)
        return self._once("substeps", 1, end, lambda: self.of.substeps.repeat(rows, axis=0))

    def core_record(self) -> CoreRecord:
        """The record in the form of the core."""
        record = self.in_core
        return record if record.begin == self.begin else record._replace(begin=self.begin)

    def _in_core(self) -> CoreRecord:
        """The arrays in the form of the core."""
        of, interface = self.of, self.interface
        selections: list[CoreSelection | None] = [None] * len(of.members)
        for i, (position, arrays) in enumerate(zip(of.positions, self.arrays)):
            if position is not None:
                springs, outputs = of.springs[i], self.output_values[i]
                selections[i] = CoreSelection(
                    position,
                    u=arrays["u"],
                    v=arrays["v"],
                    a=arrays["a"],
                    springs=None
                    if springs is None
                    else SpringRows(springs, arrays["deformation"], arrays["force"]),
                    outputs=None if outputs is None else OutputRows(outputs, *of.weights[i]),
                    internal=InternalRows(arrays.get("iterations"), arrays.get("q")),
                    rig=RigRows(*(arrays[x] for x in OF_RIG)) if OF_RIG[0] in arrays else None,
                )
        contacts = None
        if of.contacts is not None:
            contacts = ContactRows(interface["contact_impulses"], interface["contact_gaps"])
        of_constraints: dict[str, Any] = {name: interface[name] for name in OF_CONSTRAINTS}
        return CoreRecord(
            self.begin,
            self.every or 0,
            tuple(selections),
            energy=self._energies(self.energy) if of.has_energy else None,
            contacts=contacts,
            **of_constraints,
        )

    def _energies(self, rows: np.ndarray) -> np.ndarray:
        """By macro time level, subdomain and kind."""
        return rows.reshape(len(rows), len(self.of.members), len(ENERGIES))

    def history(self, end: int) -> History:
        """The History up to macro step `end`."""
        self.unshared = {}
        of, rows = self.of, {levels: self.rows(levels, end) for levels in self.of.numbers}
        subdomains: list[SubdomainHistory | None] = [None] * len(of.members)
        for i, (member, dofs, springs) in enumerate(zip(of.members, of.dofs, of.springs)):
            if dofs is None:
                continue
            count, outputs, values = rows[member.substeps], of.outputs[i], self.output_values[i]
            subdomains[i] = SubdomainHistory(
                name=member.name,
                t=self.times(member.substeps, end),
                dofs=dofs.copy(),
                springs=None if springs is None else springs.copy(),
                outputs=self._outputs(i, outputs, values, count, end),
                substep=None if member.subdomain.scheme.is_of_two_stages else member.h,
                double_after=self._double_after(member),
                n=member.n,
                dof_names=names_at(member.subdomain.dof_names, dofs),
                **{
                    name: x[:count, 0].astype(int) if name in COUNTS else x[:count]
                    for name, x in self.arrays[i].items()
                },
            )
        filled: dict[str, Any] = {
            name: self._in_users_rows(name, x[: rows[of.interface[name][0]]])
            for name, x in self.interface.items()
        }
        filled |= {name: x.made(self, end, filled) for name, x in OF_INTERFACE.items() if x.made}
        return History(
            subdomains=tuple(subdomains),
            **filled,
            keys=of.keys,
            energy=self._energy_history(rows[1], end) if of.has_energy else NO_ENERGY,
            contact_layout=() if of.contacts is None else layouts(of.contacts),
            coupling=self.coupling,
            dt=self.clock.dt,
            constraint_rows=self.constraint_rows,
        )

    def _outputs(
        self, i: int, outputs: Outputs | None, values: np.ndarray | None, rows: int, end: int
    ) -> dict[str, np.ndarray]:
        """The outputs of a subdomain, absolute ones with the motion of the ground."""
        if outputs is None or values is None:
            return {}
        values = values[:rows]
        if outputs.ground:
            t = self.times(self.of.members[i].substeps, end)
            values = values + added(self.loads[i], outputs.ground, t)
        return outputs.split(values)

    def _double_after(self, member: Member) -> float | None:
        if not member.double:
            return None
        return self.clock.t0 + (self.clock.dt if member.over is None else 0.0)

    def _energy_history(self, rows: int, end: int) -> Energy:
        by_kind = np.moveaxis(self._energies(self.energy[:rows]), -1, 0)
        kinds: dict[str, Any] = dict(zip(ENERGIES, map(np.ascontiguousarray, by_kind)))
        stored = kinds["kinetic"] + kinds["strain"]
        if self.conserved is None:
            kinds["conserved"] = None
        if self.of.contacts is None:
            kinds["contact"] = None
        return balanced(stored[0], t=self.times(1, end), **kinds)

    def _in_users_rows(self, name: str, x: np.ndarray) -> np.ndarray:
        """An array of the interface with the constraints as the user has written them."""
        rows = OF_INTERFACE[name].rows
        return getattr(self.of.core_rows, rows)(x) if rows else x


class FiledRecording(Recording):
    """The record of a run that is written to an HDF5 file interval by interval.

    Memory is allocated for one interval. Row 0 of the arrays is the beginning of the interval and
    already written. With `append` the rows of an existing file come first.
    """

    def __init__(self, wanted: Wanted, *args: Any, **options: Any):
        append, overwrite = wanted.append, wanted.overwrite
        self.file: HistoryFile | None = None
        self.old: Held | None = None
        self.earlier: EarlierRows | None = None
        self.unwritten: list[dict[str, np.ndarray]] = []  # by interval, as for `HistoryFile.write`
        super().__init__(*args, **options)
        # before the start evaluates a restoring force, on a test rig say
        self.path = target(wanted.record_to, may_exist=append or overwrite)
        if append or overwrite:
            self.old = old_file(self.path)
        try:
            if append and self.old is not None:
                if self.of.has_energy:
                    raise ValueError(f"append must come without energies: {WORKS}")
                self.earlier = EarlierRows(self.old, self.begin)
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Close the files, whose locks keep other runs out."""
        for file in (self.file, self.old):
            if file is not None:
                file.close()
        self.earlier = None

    @property
    def continues(self) -> bool:
        return self.earlier is not None

    @property
    def numbers_kept(self) -> float:
        return 0.0

    def _steps_in_memory(self) -> int:
        step = self._numbers(lambda levels: levels if self.every is None else 1.0 / self.every)
        steps = FILED_BYTES / (8.0 * step) if step > 0.0 else MOST
        return int(min(self.end - self.begin, max(steps, 1.0)))

    def pauses(self) -> Iterator[int]:
        header, arrays = contents_of(super().history(self.begin))
        header |= {"begin": self.begin, "every": self.every or 0, "nodes": self._levels()}
        header["fixed"] = sorted(arrays.keys() - header["nodes"].keys())
        if self.problem is not None:
            header["problem"] = dict(self.problem)
        if self.clock.origin == 0:  # else times are counted from a change of the steps
            header["dt"] = self.clock.dt
        if self.earlier is not None:
            self.earlier.check(header, arrays)
            header["steps"] = self.earlier.same_steps(header["steps"])
            if self.earlier.header.get("macro_step") != header["macro_step"]:
                header["macro_step"] = None
            header["begin"], arrays = self.earlier.begin, self.earlier.arrays
        self.file = HistoryFile(self.path, header, arrays, self.end, self.begin, self.old)
        self.earlier, arrays = None, {}  # unmaps the file that was replaced
        if self.old is not None:
            self.old.close()
        steps = 1
        while self.begin < self.end:
            begin = perf_counter()
            yield min(self.end, self.begin + steps)
            seconds = perf_counter() - begin
            longer = min(2 * steps, self.steps_in_memory)
            steps = longer if seconds < FILED_SECONDS else max(1, steps // 2)

    def _levels(self) -> dict[str, int]:
        """Time levels per macro step of all growing arrays, by name."""
        levels = {
            name: self.of.levels_of(name)
            for name, x in OF_INTERFACE.items()
            if x.columns in self.of.interface_columns
        }
        for i, (member, columns, output) in enumerate(
            zip(self.of.members, self.of.columns, self.of.outputs)
        ):
            if self.of.dofs[i] is not None:
                levels |= {f"{i}.{name}": member.substeps for name in ("t", *columns)}
                count = 0 if output is None else len(output.sizes)
                levels |= {output_array(i, k): member.substeps for k in range(count)}
        fields = [*ENERGY_FIELDS]
        fields += ["conserved"] * (self.conserved is not None)
        fields += ["contact"] * (self.of.contacts is not None)
        return levels | {f"energy.{name}": 1 for name in fields if self.of.has_energy}

    def keep(self, end: int) -> None:
        """Write the rows; those that the file does not take remain in memory."""
        if end <= self.begin:
            return
        assert self.file is not None
        arrays, failure = contents_of(super().history(end))[1], None
        if not self.unwritten:
            try:
                self.file.write(arrays, self.begin, end)
            except OSError as error:
                failure = error
        if self.unwritten or failure is not None:
            self.unwritten.append({name: x.copy() for name, x in arrays.items()})
        self.begin = end
        if failure is not None:
            raise failure

    def history(self, end: int) -> History:
        if self.file is None:
            return super().history(end)
        with suppress(OSError):  # the run has raised it already
            self.keep(end)
        header, arrays = self._contents(self.file)
        fields = fields_of(header, arrays, self.path, History, SubdomainHistory)
        return replace(History(**fields), keys=self.of.keys)

    def _contents(self, file: HistoryFile) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Header and arrays of all rows, or of those in memory where the file is damaged."""
        rest = self.unwritten
        with suppress(OSError):
            file.count()
        try:
            header, arrays = file.contents()
        except (OSError, ValueError):
            if not rest:
                raise
            header, arrays, rest = file.header, rest[0], rest[1:]
        growing = {
            name: [x, *(piece[name][1:] for piece in rest)]
            for name, x in arrays.items()
            if name in header["nodes"]
        }
        if not rest or not fits(sum(x.nbytes for pieces in growing.values() for x in pieces)):
            return header, dict(arrays)
        return header, {**arrays, **{x: np.concatenate(y) for x, y in growing.items()}}


def rows_of(steps: int, every: int | None, levels: int) -> int:
    """Maximum number of rows of macro steps with `levels` time levels in each."""
    return 1 + steps * levels if every is None else 2 + steps // every


def recording_class(wanted: Wanted) -> Callable[..., Recording]:
    """What makes the recording of a run."""
    append, overwrite = flag(wanted.append, "append"), flag(wanted.overwrite, "overwrite")
    if append and overwrite:
        raise ValueError("append and overwrite must not both be True")
    if wanted.record_to is not None:
        return partial(FiledRecording, wanted)
    if append or overwrite:
        raise ValueError("append and overwrite must come with record_to, got record_to=None")
    return Recording


def chosen_dofs(
    record: Mapping[Any, Any] | None,
    keys: Sequence[tuple[str, Subdomain]],
    outputs: Sequence[Outputs | None],
) -> list[np.ndarray | None]:
    """The dofs to record of each subdomain, None for a subdomain left out without outputs."""
    if record is None:
        return [np.arange(s.n) for _, s in keys]
    none = np.arange(0)
    chosen: list[np.ndarray | None] = [None if output is None else none for output in outputs]
    for i, dofs in by_index(record, keys, "record").items():
        name, subdomain = keys[i]
        what = f"record[{name!r}]"
        chosen[i] = (
            np.arange(subdomain.n)
            if dofs is None
            else dof_list(dofs, subdomain.n, what, subdomain.dof_names)
        )
    return chosen


def with_rigs(
    dofs: Sequence[np.ndarray | None], keys: Sequence[tuple[str, Subdomain]]
) -> list[np.ndarray | None]:
    """The dofs to record, none of a rig that is left out. ValueError where there is no rig."""
    has_rig = [bool(devices_of(s.restoring)) for _, s in keys]
    if not any(has_rig):
        raise ValueError(
            "rig must be False without a specimen behind an actuator or a compensator, got True"
        )
    none = np.arange(0)
    return [none if x is None and has else x for x, has in zip(dofs, has_rig)]
