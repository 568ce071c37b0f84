"""A type of load is one class (docs/adding.md): one made here, with everything that loads meet."""

import numpy as np
import pytest

import pmalpha as pm
from pmalpha.problem import forms
from pmalpha.problem.loads import Load
from pmalpha.problem.matrices import checksum


class Ramp(Load):
    """slopes * t, on all dofs."""

    def __init__(self, slopes):
        self.slopes = np.array(slopes, dtype=float)
        self.n = self.slopes.size
        self._freeze()

    def __call__(self, t):
        return self.slopes * t

    def _core(self, order, scale=None):
        values = np.outer([0.0, 1e6], self.slopes[order])
        return forms.Sampled(values, None, 1e6, True, 0.0)

    def _facts(self):
        return f"Ramp {checksum(self.slopes)}"


def frame(force, name="frame", **options):
    K = [[30.0, -10.0], [-10.0, 10.0]]
    return pm.Subdomain([1.0, 2.0], K, scheme=pm.Newmark(), force=force, name=name, **options)


def coupled(force, **options):
    tail = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark(), name="tail")
    s = frame(force, **options)
    return pm.Coupler([s, tail], pm.tie(s, [1], tail, [0]), dt=0.05, coupling="gc")


RAMP = Ramp([1.0, -2.0])
SAMPLED = pm.SampledForce(np.outer([0.0, 1e6], [1.0, -2.0]), 1e6)


@pytest.mark.parametrize("options", [{}, {"substeps": 3}])
def test_a_run_and_cases_side_by_side_take_it_as_the_samples_that_it_is(options):
    expected = coupled(SAMPLED, **options).run(1.0)
    for history in (
        coupled(RAMP, **options).run(1.0),
        coupled([RAMP], **options).run(1.0),
        coupled(None, **options).run_each([{"force": {"frame": RAMP}}] * 4, 1.0)[2],
    ):
        np.testing.assert_array_equal(history["frame"].u, expected["frame"].u)
    assert np.abs(expected["frame"].u).max() > 0.05


def test_with_a_constant_load_it_is_their_sum():
    both = coupled([RAMP, np.array([3.0, 0.5])]).run(0.5)
    expected = [coupled(force).run(0.5)["frame"].u for force in (RAMP, [3.0, 0.5])]
    # three solutions of a linear problem, of size 1
    np.testing.assert_allclose(both["frame"].u, sum(expected), atol=1e-14)


def test_checkpoints_compare_it_by_its_facts(tmp_path):
    coupler = coupled(RAMP)
    coupler.step(3)
    coupler.save(tmp_path / "state")
    again = coupled(RAMP)
    again.load(tmp_path / "state")
    assert again.time == coupler.time
    with pytest.raises(ValueError, match="force of 'frame'"):
        coupled(Ramp([1.0, -3.0])).load(tmp_path / "state")


def test_the_error_is_estimated_of_the_same_load():
    estimate, expected = (coupled(x).estimate_error(0.5) for x in (RAMP, SAMPLED))
    assert str(estimate) == str(expected)


def test_a_frozen_coupler_has_it(tmp_path):
    for name, force in (("ramp", RAMP), ("sampled", SAMPLED)):
        coupled(force).freeze(tmp_path / name)
    assert (tmp_path / "ramp").read_bytes() == (tmp_path / "sampled").read_bytes()


def test_what_it_cannot_do_is_refused_by_its_name():
    with pytest.raises(ValueError, match="force must act on 2 dofs, got a Ramp on 3"):
        frame(Ramp([1.0, 2.0, 3.0]))
    with pytest.raises(TypeError, match="velocity must be a SampledForce, .* not a force"):
        pm.Constraint({"frame": [[1.0, 0.0]]}, velocity=Ramp([1.0]))
    with pytest.raises(TypeError, match="motion must be a callable"):
        pm.contact("a", [0], "b", [0], motion=Ramp([1.0]))
    with pytest.raises(ValueError, match="force must not be a Ramp for a reduction"):
        frame(RAMP).reduced(keep=[1], modes=1)


def test_a_ground_motion_prescribes_no_motion_of_a_contact():
    quake = pm.BaseAcceleration([0.0, 1.0], [1.0], M=[2.0], dt=0.1)
    with pytest.raises(TypeError, match="motion must be a callable"):
        pm.contact("a", [0], "b", [0], motion=quake)
