"""Ground motions of subdomains that are tied: displacements relative to the ground in all."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import ConstraintWarning, warn
from ..problem.forces import BaseAcceleration, Force, terms_of
from .member import Member
from .schedule import Rows


def warn_of_ground(
    members: Sequence[Member], forces: Sequence[Force], constraints: Sequence[Rows], first: int = 0
) -> None:
    """One ConstraintWarning for the subdomains with mass that are tied to one with a ground motion
    and have none.

    first: number of the first member among the subdomains of the constraints.
    """
    moves = [any(isinstance(x, BaseAcceleration) for x in terms_of(force)) for force in forces]
    if all(moves) or not any(moves):
        return
    neighbours: dict[str, str] = {}
    for rows in constraints:
        indices = [i - first for i in rows.matrices if 0 <= i - first < len(members)]
        moved = [i for i in indices if moves[i]]
        for i in indices:
            member = members[i]
            if moved and not moves[i] and member.subdomain.massless.size < member.n:
                neighbours.setdefault(member.name, members[moved[0]].name)
    if not neighbours:
        return
    pairs = [
        f"{at!r} has none, tied to {other!r}, which has one" for at, other in neighbours.items()
    ]
    warn(
        "a ground motion must act on all tied subdomains with mass, since displacements are "
        f"relative to the ground: {'; '.join(pairs)}. The same BaseAcceleration(record) can be "
        "the force of each: it takes the mass of its subdomain",
        ConstraintWarning,
    )
