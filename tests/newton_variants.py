"""Couplings of iterated subdomains that were not chosen: docs/method/newton.md has their errors."""

import newton_reference
import numpy as np
from newton_step import Iteration


def single_pass(members, k, g, newton, iterate):
    """A fine step with one interface problem: laws of the free solutions, then one correction.

    With `iterate`, the subdomains are then iterated on their own under these multipliers.
    """
    for x in members:
        begins = (k - 1) % x.stride == 0
        x.open(k)
        if x.iterated and begins and x.stride == 1:
            Iteration([x.trial], newton).run()
            x.trial.evaluate()
            x.trial.refresh()
    laws = [x.trial.law() if x.closes(k) else x.law(k) for x in members]
    Lam = np.linalg.solve(sum(G for _, G in laws), g - sum(o for o, _ in laws))
    for x in members:
        if x.closes(k):
            x.trial.evaluate()
            if iterate:
                x.trial.move(x.trial.w, Lam)
                Iteration([x.trial], newton).run()
            else:
                x.trial.move(x.trial.w + x.trial.correction(Lam)[0], Lam)
        x.take(k, Lam)
    return Lam


def without_rebasing(member, k, original=newton_reference.FineMember.open):
    """FineMember.open with the law of the last substep's end as o_n."""
    begins = (k - 1) % member.stride == 0
    old = getattr(member, "ends", None)
    original(member, k)
    if begins and member.iterated and member.stride > 1 and old is not None and not member.changed:
        member.ends = old[1], member.ends[1]
    member.changed = False
