"""Fewer cases than a full product: every pair of values of two parameters occurs in one of them."""

from itertools import combinations, cycle, product


def pairwise(*values):
    """Tuples with one of each of these lists, for ``pytest.mark.parametrize``.

    Greedy: of the full product always the case with most pairs that have not occurred yet, so
    faults that need two values together are found, and those that need three perhaps.
    """
    cases = list(product(*(range(len(x)) for x in values)))

    def pairs(case):
        return {(i, j, case[i], case[j]) for i, j in combinations(range(len(case)), 2)}

    chosen, missing = [], set().union(*map(pairs, cases))
    while missing:
        case = max(cases, key=lambda x: len(pairs(x) & missing))
        missing -= pairs(case)
        chosen.append(tuple(x[k] for x, k in zip(values, case)))
    return chosen


def in_turn(names, *others):
    """Each of the names with one of the others in turn, for what does not depend on both."""
    return list(zip(names, cycle(others)))
