"""Compiled internal forces: as their Python twins, bitwise; errors; threads without Python."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from compiled import INTERNAL
from compiled import by_cffi as compiled_by_cffi
from compiled import by_numba as compiled_by_numba
from newton_coupled import same_bits
from pairwise import pairwise
from scipy import LowLevelCallable
from test_checkpoint import snapshot

import pmalpha as pm

PAGE = Path(__file__).parent.parent / "docs" / "elements.md"
N = 3
DIAGONAL = sp.eye_array(N, format="csr")


def python(t, u, v, q):
    """Cubic springs with a dashpot, and a plastic deformation that follows beyond 0.25."""
    d = u - q
    p = np.where(d > 0.25, u - 0.25, np.where(d < -0.25, u + 0.25, q))
    yields = np.abs(d) > 0.25
    e = np.where(yields, np.sign(d) * 0.25, d)
    f = 40.0 * e + 2.0 * u + 8.0 * u * u * u + 0.5 * v
    k = np.where(yields, 2.0, 42.0) + 24.0 * u * u
    return f, k, np.full(N, 0.5), p


def law(t, n, u, v, q, f, K, C, q1, user):
    for i in range(n):
        d = u[i] - q[i]
        e, k, p = d, 42.0, q[i]
        if d > 0.25:
            e, k, p = 0.25, 2.0, u[i] - 0.25
        elif d < -0.25:
            e, k, p = -0.25, 2.0, u[i] + 0.25
        f[i] = 40.0 * e + 2.0 * u[i] + 8.0 * u[i] * u[i] * u[i] + 0.5 * v[i]
        q1[i] = p
        if K:
            K[i] = k + 24.0 * u[i] * u[i]
            C[i] = 0.5
    return 0


def by_ctypes():
    return LowLevelCallable(INTERNAL(law))


def by_cffi():
    return compiled_by_cffi(law, 7)


def by_numba():
    numba = pytest.importorskip("numba")

    # numba has no truth value of a pointer, but the address of an array
    def source(t, n, u, v, q, f, K, C, q1, user):
        wanted = numba.carray(K, (n,)).ctypes.data != 0
        for i in range(n):
            d = u[i] - q[i]
            e, k, p = d, 42.0, q[i]
            if d > 0.25:
                e, k, p = 0.25, 2.0, u[i] - 0.25
            elif d < -0.25:
                e, k, p = -0.25, 2.0, u[i] + 0.25
            f[i] = 40.0 * e + 2.0 * u[i] + 8.0 * u[i] * u[i] * u[i] + 0.5 * v[i]
            q1[i] = p
            if wanted:
                K[i] = k + 24.0 * u[i] * u[i]
                C[i] = 0.5
        return 0

    return compiled_by_numba(source, 7)


MAKERS = [by_ctypes, by_cffi, by_numba]


def coupled(internal, coupling="pm", threads=1, tangent="full"):
    """Two implicit subdomains, one of them with double steps, and an explicit one."""
    K = np.array([[3.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 1.0]])
    subdomains = []
    for i, name in enumerate("abc"):
        scheme = pm.GeneralizedAlpha(0.6, explicit=i == 2)
        how = dict(substeps=2**i, double_step=coupling != "gc" and i == 0, u0=[0.5, -0.6, 0.5])
        how |= dict(scheme=scheme, internal=internal, name=name)
        subdomains.append(pm.Subdomain([1.0, 2.0, 1.5], K, **how))
    a, b, c = subdomains
    ties = [pm.tie(a, [0], b, [0]), pm.tie(b, [2], c, [2])]
    newton = pm.Newton(tangent=tangent)
    return pm.Coupler(subdomains, ties, dt=0.1, coupling=coupling, threads=threads, newton=newton)


def twin():
    return pm.InternalForce(python, history=np.zeros(N), pattern=DIAGONAL)


def compiled(function):
    return pm.InternalForce(function, history=np.zeros(N), pattern=DIAGONAL)


@pytest.mark.parametrize(
    ("make", "threads", "coupling", "tangent"),
    pairwise(MAKERS, [1, 2, 3], ["gc", "pm", "macro"], ["full", "reuse"]),
)
def test_a_compiled_force_gives_the_bits_of_its_python_twin(make, threads, coupling, tangent):
    expected = coupled(twin(), coupling, tangent=tangent).run(steps=8)
    history = coupled(compiled(make()), coupling, threads, tangent).run(steps=8)
    assert abs(expected["a"].q).max() > 0.1 and expected["a"].iterations.max() > 2
    same_bits(history, expected)


def test_beside_a_python_force_and_a_spring_it_is_one_of_a_sum():
    function = compiled(by_ctypes())
    spring = pm.CubicSpring([0, 1], k=1.0, k3=2.0)
    extra = pm.InternalForce(lambda t, u, v, q: (3.0 * u, np.full(N, 3.0)))
    one = coupled([function, extra, spring]).run(steps=10)
    other = coupled([twin(), extra, spring]).run(steps=10)
    for x, y in zip(one, other):
        assert abs(x.u - y.u).max() < 1e-13  # sums in another order


@pytest.mark.parametrize(
    ("coupling", "code", "threads"), [("gc", 3, 1), ("pm", -7, 2), ("macro", 3, 2)]
)
def test_a_code_stops_the_run_at_a_macro_step_and_reaches_the_caller(coupling, code, threads):
    calls = []

    def fails_once(t, *args):
        if 0.35 < t and not calls:
            calls.append(t)
            return code
        return law(t, *args)

    function = compiled(LowLevelCallable(INTERNAL(fails_once)))
    c = coupled(function, coupling, threads)
    expected = coupled(compiled(by_ctypes()), coupling)
    with pytest.raises(pm.CallbackError, match=f"returned {code} in macro step 3") as caught:
        c.run(steps=10)
    error = caught.value
    assert (error.code, error.what, error.step) == (code, "internal force", 3)
    assert error.subdomain in "abc" and error.time == pytest.approx(0.3)
    assert c.step_count == 3
    c.step(7)
    expected.step(10)
    for name in "abc":
        np.testing.assert_array_equal(c.state(name).a, expected.state(name).a)
    assert snapshot(c) == snapshot(expected)


def test_a_code_at_the_start_reaches_the_caller():
    function = compiled(LowLevelCallable(INTERNAL(lambda *args: 5)))
    with pytest.raises(pm.PmalphaError, match="returned 5"):
        coupled(function).run(steps=1)


def test_not_a_number_from_a_compiled_force_ends_the_run():
    def spoiled(t, n, u, v, q, f, *rest):
        code = law(t, n, u, v, q, f, *rest)
        if t > 0.35:
            f[1] = np.nan
        return code

    c = coupled(compiled(LowLevelCallable(INTERNAL(spoiled))))
    words = r"compiled functions returned for dof 1 at t = 0\.4 is not finite"
    with pytest.raises(pm.ConvergenceError, match=words) as caught:
        c.run(steps=10)
    assert c.step_count == 3 and caught.value.time == pytest.approx(0.4)


def test_a_compiled_force_continues_the_run_of_its_python_twin(tmp_path):
    one, other = coupled(twin()), coupled(compiled(by_ctypes()))
    one.step(4)
    one.save(tmp_path / "state")
    other.load(tmp_path / "state")
    for c in (one, other):
        c.step(4)
    assert snapshot(one) == snapshot(other)


# ---- the examples of the page ---------------------------------------------------------------


@pytest.mark.parametrize("tool", ["ctypes", "cffi", "numba"])
def test_the_examples_of_the_page_are_the_same_friction_element(tool):
    pytest.importorskip(tool)
    text = PAGE.read_text()
    programs = re.findall(
        r"```python\n(.*?)```", text[text.index("## Compiled forces") :], re.DOTALL
    )
    (program,) = [x for x in programs if f"import {tool}" in x]
    names = {}
    exec(compile(program, f"{PAGE.name}, {tool}", "exec"), names)
    expected = friction_run(pm.InternalForce(friction, history=[0.0]))
    same_bits(friction_run(names["force"]), expected)


def friction(t, u, v, q):
    d = 100.0 * (u - q)
    f = np.clip(d, -1.0, 1.0)
    return f, np.where(np.abs(d) < 1.0, 100.0, 0.0), None, u - f / 100.0


def friction_run(force):
    s = pm.Subdomain(
        [1.0], [4.0], scheme=pm.GeneralizedAlpha(0.8), internal=force, v0=[2.0], name="s"
    )
    return pm.Coupler([s], dt=0.05).run(steps=40)
