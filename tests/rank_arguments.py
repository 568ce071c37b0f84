"""What each rank does in the tests of wrong arguments."""

import numpy as np
from rank_problems import RANK, SIZE, WORLD, chain, report, ties

import pmalpha as pm


def one_of(kind, call, *words, failed=SIZE - 1, everywhere=False):
    """An error of a call: of one rank, named on the others, or the same everywhere."""
    try:
        call(RANK == failed)
    except (ValueError, TypeError, pm.PmalphaError, OSError, MemoryError) as error:
        others = kind if everywhere or issubclass(kind, pm.PmalphaError) else pm.PmalphaError
        assert type(error) is (kind if RANK == failed else others), repr(error)
        assert all(word in str(error) for word in words), str(error)
        assert everywhere or RANK == failed or f"rank {failed}: " in str(error), str(error)
    else:
        raise AssertionError(f"no error: {words}")


def arguments():
    """Wrong arguments on one rank raise on all, and nothing waits for ever."""

    def make(dt=0.01, constraints=None, own=None, name=f"r{RANK}", coupling="pm", **options):
        own = [chain(3, name)] if own is None else own
        return pm.Coupler(
            own, constraints or ties(), dt=dt, coupling=coupling, comm=WORLD, **options
        )

    singular = pm.Subdomain([[1.0, 2], [2, 1]], np.eye(2), scheme=pm.Newmark(), name=f"r{RANK}")
    one_of(ValueError, lambda bad: make(dt=-1.0 if bad else 0.01), "dt must be positive")
    one_of(ValueError, lambda bad: make(coupling="pn" if bad else "pm"), "coupling must be")
    one_of(TypeError, lambda bad: make(own=3 if bad else None), "subdomains must be a list")
    one_of(ValueError, lambda bad: make(dt=0.02 if bad else 0.01), "dt, ", everywhere=True)
    one_of(ValueError, lambda bad: make(name="x"), "names of subdomains", everywhere=True)
    one_of(
        ValueError, lambda bad: make(name="x" if bad else f"r{RANK}"), "must name", everywhere=True
    )
    one_of(
        ValueError,
        lambda bad: make(constraints=[pm.tie("r0", 2, "r1", int(bad))]),
        "constraints must be the same on all ranks",
        everywhere=True,
    )
    one_of(
        pm.FactorizationError,
        lambda bad: make(own=[singular] if bad else None, constraints=[pm.tie("r0", 0, "r1", 0)]),
        f"'r{SIZE - 1}'",
    )
    obstacle = pm.contact("r0", [0], gap=1.0)
    contacts = [*ties(), obstacle]
    refusal = "contacts need a Coupler without comm"
    one_of(ValueError, lambda bad: make(constraints=contacts), refusal, everywhere=True)
    coupler = make()
    one_of(ValueError, lambda bad: coupler.static(steps=1 + bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(steps=3 + bad), "the call must be", everywhere=True)
    one_of(ValueError, lambda bad: coupler.step(3 + bad), "the call must be", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(steps=3, every=2 + bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(1.0, energy=bad), "the call", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(1.0, record={"x": None} if bad else None), "record")
    one_of(ValueError, lambda bad: coupler.reset(u0={f"r{RANK}": [0.0] * (3 + bad)}), "u0")
    one_of(
        ValueError,
        lambda bad: coupler.reset() if bad else coupler.step(),
        "the call",
        everywhere=True,
    )
    for refused in (
        coupler.assembled,
        lambda: coupler.modes(1),
        lambda: coupler.freeze("not_written.pma"),
    ):
        one_of(ValueError, lambda bad, f=refused: f(), "without comm", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run_each([{}], 1.0), "without comm", everywhere=True)
    one_of(ValueError, lambda bad: coupler.run(1.0, until=bool), "without comm", everywhere=True)
    assert coupler.step_count == 0
    noise = pm.Constraint({"r0": [[1.0, 0.0, 0.0]]}, lambda t: [(t > 0.05) * float(RANK)])
    driven = make(constraints=[*ties(), noise])
    one_of(
        ValueError,
        lambda bad: driven.run(1.0),
        "a prescribed velocity must be the same on all ranks",
        everywhere=True,
    )
    one_of(ValueError, lambda bad: coupler.change_steps(0.01 + bad), "the call", everywhere=True)
    one_of(
        ValueError,
        lambda bad: coupler.change_steps(0.02, {f"r{RANK}": 1 - bad}),
        "substeps of",
    )
    one_of(
        ValueError,
        lambda bad: coupler.change_steps(0.02, {f"r{RANK}": 3 if bad else 2}),
        "must divide",
        everywhere=True,
    )
    assert coupler.dt == 0.01
    coupler.run(steps=2)
    repr(coupler)
    report("arguments")
