"""Growth beside subdomains with an unsymmetric K, for which (M9) proves nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..problem.matrices import absolute, diagonal, is_symmetric, product, skew_part
from .member import Member
from .schedule import MACRO

# Substeps in a step of a subdomain with an unsymmetric K up to which nothing grew beside an
# absorbing layer: those of schemes with damping, and of undamped explicit ones.
BESIDE_SKEW, UNDAMPED_BESIDE_SKEW = 5, 2
# Skew part of K over what damping takes at the frequency of a dof, from which on one in ten of
# what is stable uncut grew in double steps, one in seventy in others; below 2 none did.
CIRCULATORY = 10.0


def is_unsymmetric(member: Member) -> bool:
    """Whether K is unsymmetric, of a subdomain that need not be symmetric."""
    return not is_symmetric(member.subdomain.K)


def doubts_of_skew(skew: Sequence[Member], members: Sequence[Member], coupling: str) -> list[str]:
    """Why the motion can grow beside these members, of which K is unsymmetric."""
    doubts = []
    for member in skew:
        rows = np.unique(sp.coo_array(member.L.matrix).row)
        excess = circulation(member) if all(x.subdomain.is_linear for x in members) else 0.0
        for other in members:
            if other is member or not np.isin(sp.coo_array(other.L.matrix).row, rows).any():
                continue
            why = _restless(other, member) if coupling in MACRO else ""
            if why:
                doubts.append(
                    f'coupling="{coupling}" can grow slowly where subdomain {other.name!r} {why} '
                    f"is tied to {member.name!r} with an unsymmetric K: see coupler.growth(), and "
                    'take coupling="gc", fewer substeps or rho of 0.8 or less'
                )
            elif excess > CIRCULATORY and _steps_otherwise(other, member, coupling):
                cure = "" if coupling == "gc" else 'coupling="gc" or '
                doubts.append(
                    f'coupling="{coupling}" can grow slowly where subdomain {other.name!r} is tied '
                    f"to {member.name!r}, of which the skew part of K is {excess:.3g} times what "
                    f"its C takes at the frequencies of its dofs: see coupler.growth(), and take "
                    f"{cure}smaller steps"
                )
    return doubts


def circulation(member: Member) -> float:
    """The largest |k_ij - k_ji| / 2, summed over a row, over c_ii sqrt(k_ii / m_ii).

    Between dofs without gyroscopic terms, which an absorbing layer has with its stresses.
    """
    s = member.subdomain
    S, G = skew_part(s.K), None if s.C is None else skew_part(s.C)
    assert S is not None
    m, k = diagonal(s.M), diagonal(s.K)
    c = np.zeros(s.n) if s.C is None else diagonal(s.C)
    alone = (m > 0.0) & (k > 0.0)
    if G is not None:
        alone &= product(absolute(G), np.ones(s.n)) == 0.0
    feeds = np.where(alone, product(absolute(S), alone.astype(float)), 0.0)
    chosen = feeds > 0.0
    with np.errstate(divide="ignore"):
        ratios = feeds[chosen] / (np.maximum(c, 0.0)[chosen] * np.sqrt(k[chosen] / m[chosen]))
    return float(np.max(ratios, initial=0.0))


def _steps_otherwise(member: Member, other: Member, coupling: str) -> bool:
    """Whether a tie to the other one is not a part of one scheme of both."""
    one, two = member.subdomain.scheme, other.subdomain.scheme
    return coupling == "pm" or one != two or member.substeps != other.substeps


def _restless(member: Member, beside: Member) -> str:
    """What of a subdomain makes an unsymmetric one beside it grow, or empty."""
    s, ratio = member.subdomain, member.substeps / beside.substeps
    undamped = s.scheme.explicit and s.scheme.is_newmark and not member.is_damped
    if ratio > BESIDE_SKEW:
        return f"with {ratio:.3g} substeps in a step of the other"
    if undamped and ratio > UNDAMPED_BESIDE_SKEW:
        return f"of an undamped explicit scheme with {ratio:.3g} substeps in a step of the other"
    return ""
