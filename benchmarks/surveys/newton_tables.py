"""The tables of docs/method/newton.md, measured with the reference.

    export PYTHONPATH=tests
    python benchmarks/surveys/newton_tables.py variants | opening | growth | order | policies

`variants`: the stiff cubic chain by methods that were not chosen; `opening`: a pendulum with other
laws of the coarse subdomain; `growth`: the chain and a contact by rho; `order`: two Duffing
oscillators; `policies`: iterations with fresh and kept tangents, with and without the line search.
Minutes in all.
"""

import contextlib
import sys
from unittest import mock

import newton_reference
import numpy as np
from newton_chains import OMEGA, SCHEDULES, N, energy, problems, stiff_chain
from newton_problems import chain, duffing_error, duffing_pair, pendulum, pendulum_error
from newton_reference import run, run_macro
from newton_step import ConvergenceError, Iteration, Newton, Trial
from newton_variants import single_pass, without_rebasing
from reference import Subdomain
from reference import run as run_linear

# ---- variants that were not chosen ----------------------------------------------------------


def restoring(s):
    """The same subdomain with its internal force as a restoring force and the initial tangent."""
    values = {name: getattr(s, name) for name in s.__dataclass_fields__}
    f = values.pop("internal")
    q = values.pop("history")
    K_r = f(0.0, s.u0, s.v0, q)[1]
    values.update(restoring=lambda t, u, v: f(t, u, v, q)[0], K_r=K_r)
    return Subdomain(**values)


def variants():
    """Largest energy of the stiff cubic chain, relative to its initial one, and the largest [u]."""
    newton = Newton(tol=1e-10)
    for x, steps in ((1.0, 200), (10.0, 600)):
        for name in ("gc, s = 1", "pm, s = 1", "pm, s = 5"):
            subdomains, L = stiff_chain(rho=0.8, **SCHEDULES[name][1])
            linear = [restoring(s) for s in subdomains]
            dt = x / OMEGA
            shown = {
                "coupled": measured(run, subdomains, L, dt, steps, newton),
                "restoring": measured(run_linear, linear, L, dt, steps),
            }
            for title, iterate in (("single pass", False), ("multipliers fixed", True)):

                def step(members, k, g, newton, iterate=iterate):
                    return single_pass(members, k, g, newton, iterate)

                with mock.patch.object(newton_reference, "fine_step", step):
                    shown[title] = measured(run, subdomains, L, dt, steps, newton)
            print(f"omega dt = {x:g}, {name}:", shown, flush=True)


class Unopened(Iteration):
    """No iteration of an opening subdomain: its law is that of the first guess."""

    def run(self):
        if self.others is not None:
            super().run()


def opening():
    """Largest errors of u of the pendulum of stiff bars over 1 s, s = 5, n = 50, 100, 200."""
    variants = {
        "as described": contextlib.nullcontext(),
        "without re-basing": mock.patch.multiple(
            newton_reference.FineMember, open=without_rebasing, changed=True, create=True
        ),
        "law of the first guess": mock.patch.object(newton_reference, "Iteration", Unopened),
    }
    for title, patch in variants.items():
        for name in ("gc, s = 5", "pm, s = 5"):
            errors = []
            for n in (50, 100, 200):
                with patch:
                    subdomains, L = pendulum(**SCHEDULES[name][1])
                    errors.append(pendulum_error(run(subdomains, L, 1.0 / n, n)))
            print(f"{title}, {name}:", [f"{x:.2g}" for x in errors], flush=True)


def growth():
    """Largest energy of the stiff cubic chain by rho, omega dt = 10, 600 steps of "gc", s = 1.

    Then the largest velocity of a chain with contact, 1 at the start.
    """
    for rho in (0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0):
        subdomains, L = stiff_chain(rho=rho)
        print(rho, measured(run, subdomains, L, 10.0 / OMEGA, 600, Newton(tol=1e-10)))

    law, values, (dt,), steps = problems()["penalty contact, rho 0"]
    for name, (function, schedule) in SCHEDULES.items():
        peaks = []
        for rho in (0.0, 0.5):
            subdomains, L = chain(N, law, **{**values, "rho": rho}, **schedule)
            try:
                result = function(subdomains, L, dt, steps)
                peaks.append(f"{max(abs(x.v).max() for x in result.subdomains):.3g}")
            except ConvergenceError as error:
                peaks.append(str(error))
        print("contact, largest velocity for rho 0 and 0.5:", name, peaks, flush=True)


def measured(function, *arguments):
    """Largest relative energy and largest displacement jump, or why there is none."""
    try:
        with np.errstate(all="ignore"):
            result = function(*arguments)
            E = energy(result)
    except (ConvergenceError, np.linalg.LinAlgError) as error:
        return str(error)
    if not np.isfinite(E).all():
        return "overflow"
    return f"{E.max():.3g}, {abs(result.displacement_jump).max():.2g}"


# ---- order ----------------------------------------------------------------------------------


def order():
    """Errors of v and observed orders of u and v of the Duffing pair over t = 2."""
    counts = np.array([120, 240, 480, 960])
    for name, problem in {
        "gc, s = 1": {},
        "pm, s = 1": {"double": True},
        "gc, s = 4": {"ss": (1, 4)},
        "pm, s = 4": {"ss": (1, 4), "double": True},
        "macro, s = 1": {},
        "macro, s = 4": {"ss": (1, 4)},
        "macro, s = 20": {"ss": (1, 20)},
        "macro, double step": {"double": True},
    }.items():
        for explicit in (False, True):
            errors, work, passes = [], [], []
            for n in counts:
                subdomains, L = duffing_pair(explicit=explicit, **problem)
                function = run_macro if name.startswith("macro") else run
                result = function(subdomains, L, 2.0 / n, int(n), Newton(tol=1e-10))
                errors.append(duffing_error(result))
                work.append(result.subdomains[0].iterations[1:].mean())
                passes.append(result.passes.mean() if len(result.passes) else 0.0)
            slopes = np.log2(np.array(errors[:-1]) / errors[1:])[-1]
            print(name, "explicit B" if explicit else "", slopes.round(2), end=" ")
            print(
                [f"{v:.2g}" for _, v in errors], np.round(work, 2), np.round(passes, 2), flush=True
            )


# ---- policies -------------------------------------------------------------------------------


def policies():
    """Iterations a substep, factors a substep and failures over all schedules."""
    never = mock.patch.object(Iteration, "search", lambda self, s_1: 1.0)
    for title, (law, values, steps_of, steps) in problems().items():
        for policy, tangent, patch in (
            ("full, no search", "full", never),
            ("full", "full", None),
            ("reuse", "reuse", None),
        ):
            total, factors, substeps, failed, tried = 0, [], 0, 0, 0
            keep = mock.patch.object(Trial, "refresh", counted(factors))
            with keep, patch or contextlib.nullcontext():
                for dt in steps_of:
                    for function, schedule in SCHEDULES.values():
                        subdomains, L = chain(N, law, **values, **schedule)
                        tried += 1
                        try:
                            result = function(subdomains, L, dt, steps, Newton(tangent=tangent))
                        except (ConvergenceError, np.linalg.LinAlgError):
                            failed += 1
                            continue
                        total += sum(x.iterations.sum() for x in result.subdomains)
                        substeps += sum(len(x.t) - 1 for x in result.subdomains)
            done = f"{total / substeps:.1f}, {len(factors) / substeps:.1f}" if substeps else "-"
            print(f"{title}, {policy}: {done}; failed {failed} of {tried}", flush=True)


def counted(calls):
    """Trial.refresh that counts."""
    original = Trial.refresh

    def refresh(trial):
        calls.append(1)
        original(trial)

    return refresh


if __name__ == "__main__":
    {
        "variants": variants,
        "opening": opening,
        "growth": growth,
        "order": order,
        "policies": policies,
    }[sys.argv[1]]()
