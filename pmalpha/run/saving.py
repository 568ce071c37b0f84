"""The methods of a coupler that write its state to a file and read it again."""

from __future__ import annotations

import secrets
from os import PathLike
from pathlib import Path
from typing import Any

from .._checks import MOST
from ..files import NPZ, checked_path
from ..setup.ranks import file_of, joined
from . import checkpoint
from .changes import steps_facts, steps_of
from .session import Session, begin, check_call, take, together


def save(session: Session, path: str | PathLike[str]) -> None:
    """`Coupler.save`."""
    with together(session):
        check_call(session, "save")
        checked_path(path, suffixes=NPZ)
        begin(session)
        arrays = checkpoint.state_arrays(session.assembly, session.core_rows, session.options)
        steps, done = steps_facts(session), session.core.step_count
        if session.ranks is None:
            checkpoint.write(path, problem_of(session), done, arrays, steps)
            return
        # names of this save alone: files of older ones survive until all of this are written
        token = session.ranks.share(secrets.token_hex(4))[0]
        name = f"{checked_path(path)}.{done}.{token}"
        files = [file_of(name, r) for r in range(session.ranks.size)]
        checkpoint.write(files[session.ranks.rank], problem_of(session), done, arrays, steps)
        session.ranks.share(None)
        if session.ranks.rank == 0:
            names, first = [Path(file).name for file in files], session.ranks.first.tolist()
            checkpoint.write_master(checked_path(path), names, first)


def load(session: Session, path: str | PathLike[str]) -> None:
    """`Coupler.load`."""
    with together(session):
        check_call(session, "load")
        first = session.assembly.first
        own = range(first, first + len(session.parts))
        step, arrays, facts = checkpoint.read(path, problem_of(session), own)
        if session.ranks is not None:
            session.ranks.require_equal("the macro step of the files", (step, facts))
        steps, assembly = steps_of(session, path, facts)
        most = MOST // max(steps.layout.substeps)
        if not steps.clock.origin <= step <= most:
            reason = f"step_count must be in {steps.clock.origin}..{most}, got {step}"
            raise checkpoint.damaged(path, reason)
        parts, core = assembly.parts, assembly.core
        rows, options = session.core_rows, session.options
        state = checkpoint.core_state(path, arrays, assembly, rows, options)
        if session.ranks is not None:
            session.ranks.share(None)  # from here on nothing fails
        # stored values of callables are of other times
        loads = session.loads.with_steps(core, parts, steps.clock)
        loads.to_core()
        checkpoint.restore(state, parts, core, steps.clock, step)
        take(session, steps, assembly)
        session.loads, session.started, session.last_history = loads, True, None


def problem_of(session: Session) -> dict[str, Any]:
    """The description of this problem for a checkpoint; the matrices are read once."""
    if session.constants is None:
        first = session.assemblies.first.parts
        iterates = joined(session.ranks, [part.internal is not None for part in first])
        session.constants = checkpoint.constants(
            session.options,
            session.loads.names,
            session.rows.p,
            first,
            session.rows.matrices,
            iterates=any(iterates),
            contacts=session.rows.contacts,
        )
    loads = session.loads
    return session.constants | checkpoint.loads(session.parts, loads.forces, loads.motions)
