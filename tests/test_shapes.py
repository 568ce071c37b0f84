"""Shape functions and quadrature of every kind of element, against their definitions."""

import itertools
from math import factorial, prod

import numpy as np
import pytest

from pmalpha.meshes.mesh import KINDS, SHAPES
from pmalpha.structures.elasticity import RULES

NAMES = list(SHAPES)
ROUNDING = 1e-14  # of sums of up to 20 terms of size up to 7


def inside(name, count=20):
    """Points in the reference element."""
    shape = SHAPES[name]
    weights = np.random.default_rng(1).dirichlet(np.ones(shape.corners), count)
    return weights @ shape.nodes[: shape.corners]


def exact(name, exponents):
    """The integral of a monomial over the reference element."""
    if name.startswith(("line", "quad", "hexahedron")):
        return prod(1.0 / (e + 1) for e in exponents)
    if name.startswith("wedge"):
        return exact("triangle", exponents[:2]) * exact("line", exponents[2:])
    return prod(map(factorial, exponents)) / factorial(sum(exponents) + len(exponents))


def test_every_kind_but_pyramids_has_shape_functions_and_quadrature():
    assert set(KINDS) - set(SHAPES) == {"pyramid", "pyramid13"}
    assert set(RULES) == set(SHAPES)


@pytest.mark.parametrize("name", NAMES)
def test_a_shape_function_is_one_at_its_node_and_zero_at_the_others(name):
    shape = SHAPES[name]
    assert shape.nodes.shape == (KINDS[name].nodes, KINDS[name].dimension)
    np.testing.assert_array_equal(shape.values(shape.nodes), np.eye(len(shape.nodes)))


@pytest.mark.parametrize("name", NAMES)
def test_polynomials_up_to_the_order_of_the_element_are_interpolated_exactly(name):
    shape, xi = SHAPES[name], inside(name)
    order = 1 + (len(shape.nodes) > shape.corners)
    for exponents in itertools.product(range(3), repeat=xi.shape[1]):
        at_nodes, at_points = (np.prod(x**exponents, axis=1) for x in (shape.nodes, xi))
        error = np.abs(shape.values(xi) @ at_nodes - at_points).max()
        if sum(exponents) <= order:
            assert error < ROUNDING
    cubic = np.abs(shape.values(xi) @ shape.nodes[:, 0] ** 3 - xi[:, 0] ** 3).max()
    assert cubic > 1e-3  # not exact beyond


@pytest.mark.parametrize("name", NAMES)
def test_slopes_are_the_derivatives(name):
    shape, xi = SHAPES[name], inside(name)
    h = 0.25  # central differences are exact for polynomials of degree 2 in each variable
    for axis, step in enumerate(h * np.eye(xi.shape[1])):
        difference = (shape.values(xi + step) - shape.values(xi - step)) / (2.0 * h)
        np.testing.assert_allclose(shape.slopes(xi)[:, :, axis], difference, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("name", NAMES)
def test_rules_integrate_mass_and_stiffness_of_straight_elements_exactly(name):
    shape = SHAPES[name]
    order = 1 + (len(shape.nodes) > shape.corners)
    d = shape.nodes.shape[1]
    for rule, degree in zip(RULES[name], (2 * (order - 1), 2 * order), strict=True):
        assert rule.weights.min() > 0.0
        for exponents in itertools.product(range(degree + 1), repeat=d):
            if sum(exponents) <= degree:
                found = rule.weights @ np.prod(rule.points**exponents, axis=1)
                assert found == pytest.approx(exact(name, exponents), rel=0, abs=1e-15)


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith(("quad", "hexa"))])
def test_gauss_rules_of_boxes_integrate_products_of_shape_functions(name):
    exponents, (rule, _) = SHAPES[name].exponents, RULES[name]
    for e in (a + b for a in exponents for b in exponents):
        found = rule.weights @ np.prod(rule.points**e, axis=1)
        assert found == pytest.approx(exact(name, e), rel=0, abs=1e-15)


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("wedge")])
def test_rules_of_wedges_integrate_products_of_shape_functions(name):
    exponents, (rule, _) = SHAPES[name].exponents, RULES[name]
    for e in (a + b for a in exponents for b in exponents):
        found = rule.weights @ np.prod(rule.points**e, axis=1)
        assert found == pytest.approx(exact(name, e), rel=0, abs=1e-15)
