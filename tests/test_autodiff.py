"""A coupled run as a differentiable function of JAX and PyTorch: the lines of docs/gradients.md."""

from pathlib import Path

import numpy as np
import pytest

import pmalpha as pm

PAGE = Path(__file__).parents[1] / "docs" / "gradients.md"
SENSORS, STEPS = [0, 1], 30
STIFF = pm.Parameters("frame", dofs=[[0], [1]], K=[[1.0]])


def coupler(x):
    """Two masses on springs x, with a third one tied to them that is explicit."""
    frame = pm.Subdomain(
        [1.0, 1.0],
        [[x[0] + 20.0, -20.0], [-20.0, x[1] + 20.0]],
        scheme=pm.GeneralizedAlpha(0.8),
        v0=[1.0, 1.0],
        name="frame",
    )
    part = pm.Subdomain(
        [0.5],
        [10.0],
        scheme=pm.GeneralizedAlpha(0.8, explicit=True),
        substeps=3,
        v0=[1.0],
        name="part",
    )
    return pm.Coupler([frame, part], pm.tie("frame", [1], "part", [0]), dt=0.05, coupling="macro")


def run(x):
    return coupler(np.asarray(x)).run(steps=STEPS)["frame"].a[:, SENSORS].copy()


def pull(x, y):
    def product(history):
        return 0.0, {"frame": {"a": np.asarray(y)}}

    return coupler(np.asarray(x)).gradient(product, steps=STEPS, parameters=STIFF).parameters[0]


def lines_of_page(first, last):
    """The code of the page between two lines, the last one included."""
    text = PAGE.read_text()
    begin = text.index(first)
    return text[begin : text.index("\n", text.index(last, begin)) + 1]


X = np.array([30.0, 40.0])


def expected():
    """The gradient of the sum of squares, by differences."""
    h = 1e-5

    def value(x):
        return np.sum(run(x) ** 2)

    return [(value(X + h * e) - value(X - h * e)) / (2.0 * h) for e in np.eye(2)]


def test_jax():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    names = dict(jax=jax, np=np, run=run, pull=pull, levels=STEPS + 1, k=len(SENSORS))
    exec(lines_of_page("@jax.custom_vjp", "jax.pure_callback(pull"), names)
    value, gradient = jax.value_and_grad(lambda x: (names["response"](x) ** 2).sum())(X)
    assert float(value) == pytest.approx(np.sum(run(X) ** 2), rel=1e-14)
    assert np.allclose(gradient, expected(), rtol=1e-6)


def test_torch():
    torch = pytest.importorskip("torch")
    names = dict(torch=torch, np=np, run=run, pull=pull)
    exec(lines_of_page("class Response(", "torch.from_numpy(pull"), names)
    x = torch.tensor(X, requires_grad=True)
    (names["Response"].apply(x) ** 2).sum().backward()
    assert np.allclose(x.grad.numpy(), expected(), rtol=1e-6)
