"""The elimination order of tangents: a narrow band where there is one, else little fill."""

import numpy as np
import pytest
import scipy.sparse as sp

from pmalpha.problem.tangents import symmetric_union
from pmalpha.reduction.ordering import elimination_order, graph_of
from pmalpha.setup.internal_forces import narrow_order, tangent_pattern

NONE = np.zeros(0, dtype=int)


def band(n, width):
    """The pattern of a full band."""
    offsets = range(-width, width + 1)
    ones = [np.ones(n - abs(d)) for d in offsets]
    return symmetric_union([sp.csr_array(sp.diags_array(ones, offsets=offsets))], n)


def half_width(pattern):
    entries = pattern.tocoo()
    return int(np.max(np.abs(entries.row - entries.col)))


def scrambled(pattern, seed):
    """The pattern with its dofs renumbered, and the new number of each dof."""
    position = np.random.default_rng(seed).permutation(pattern.shape[0])
    order = np.argsort(position)
    return symmetric_union([pattern[order][:, order]], order.size), position


@pytest.mark.parametrize("seed", range(5))
def test_a_chain_numbered_at_random_is_eliminated_from_one_end_to_the_interface(seed):
    pattern, position = scrambled(band(50, 1), seed)
    found = tangent_pattern(pattern, np.array([position[-1]]))
    assert half_width(found.pattern) == 1
    # the ends of the chain are eliminated first and last
    assert found.order[0] == position[0] and found.order[-1] == position[-1]


@pytest.mark.parametrize("last", [[0, 1], [30, 31], [38, 39], [0, 39]])
def test_interface_dofs_come_last_wherever_they_are(last):
    found = tangent_pattern(band(40, 4), np.array(last))
    assert found.order[-2:].tolist() == last
    assert sorted(found.order) == list(range(40))


def test_an_interface_in_the_middle_of_a_chain_widens_the_band_to_it():
    _, width = narrow_order(band(41, 1), np.array([20]))
    # its two neighbours: one is eliminated last but one, the other in the middle of the order
    assert width > 10


def test_a_frame_is_eliminated_in_a_band_though_another_order_has_less_fill():
    n, floor = 200, 8  # as in benchmarks/newton.py: two joints of three dofs, two hinges
    pairs = [(0, 1), (0, 2), (1, 2), (2, 3), (3, 4), (4, 7), (5, 6), (5, 7), (6, 7), (0, 5), (1, 6)]
    cell = np.zeros((floor, floor))
    cell[tuple(np.transpose(pairs))] = 1.0
    columns = np.concatenate([np.arange(i, n - floor, floor) for i in (0, 1, 2, 5, 6, 7)])
    storeys = sp.csr_array((np.ones(columns.size), (columns + floor, columns)), shape=(n, n))
    beams = sp.csr_array(sp.kron(sp.eye_array(n // floor), cell))
    pattern = symmetric_union([storeys, beams], n)
    assert half_width(pattern) == floor
    order = elimination_order(n, graph_of([pattern]), NONE)
    assert half_width(pattern[order][:, order]) > 32
    assert half_width(tangent_pattern(pattern, NONE).pattern) == floor


def test_a_grid_wider_than_a_narrow_band_is_eliminated_with_little_fill():
    line = sp.diags_array([np.ones(39), np.ones(40), np.ones(39)], offsets=[-1, 0, 1])
    pattern = symmetric_union([sp.csr_array(sp.kron(line, line))], 1600)
    found = tangent_pattern(pattern, NONE)
    assert half_width(pattern) > 32
    np.testing.assert_array_equal(found.order, elimination_order(1600, graph_of([pattern]), NONE))
