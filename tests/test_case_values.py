"""One value for each case in place of its History: `Coupler.run_each` with `reduce`."""

import numpy as np
import pytest

import pmalpha as pm

DT, STEPS = 0.02, 60
EXPECTED = {
    "peak": lambda x: np.abs(x).max(axis=0),
    "last": lambda x: x[-1],
    "sum": lambda x: np.sum(x, axis=0),
}


def tower(threads=1):
    """A frame with springs on a base with substeps."""
    frame = pm.Subdomain(
        [2.0, 1.0, 1.0],
        [[30.0, -30.0, 0.0], [-30.0, 60.0, -30.0], [0.0, -30.0, 30.0]],
        scheme=pm.GeneralizedAlpha(0.8),
        restoring=pm.Bilinear([(1, 0), (2, 1)], 40.0, 0.3, 0.1),
        dof_names=["foot", "floor", "roof"],
        name="frame",
    )
    base = pm.Subdomain([1.0, 1.0], [500.0, 100.0], scheme=pm.Newmark(), substeps=5, name="base")
    ties = pm.tie(frame, [0], base, [0])
    return pm.Coupler([frame, base], ties, dt=DT, coupling="macro", threads=threads)


def shaken(count):
    """Cases with records of different lengths and steps: more than the lanes hold."""
    rng = np.random.default_rng(3)
    records = [rng.standard_normal(20 + 3 * k) for k in range(count)]
    steps = [DT, 0.5 * DT, 1.5 * DT]
    return [
        {
            "force": {
                "frame": [
                    pm.BaseAcceleration(x, dt=steps[k % 3], average=True),
                    [0.0, 0.0, 0.1 * k],
                ],
                "base": pm.BaseAcceleration(x, dt=steps[k % 3], average=True),
            },
            "u0": {"frame": [0.0, 0.01 * k, 0.0]},
        }
        for k, x in enumerate(records)
    ]


OPTIONS = {
    "all": {},
    "some": {
        "record": {"frame": ["roof"]},
        "every": 3,
        "record_springs": {"frame": [1]},
        "outputs": {"frame": {"drift": [[0.0, -1.0, 1.0]]}},
    },
}


def check(values, histories, make):
    """Rows of the values are reductions of the Histories; of sums, whose order is free, nearly."""
    for k, history in enumerate(histories):
        for name in ("multipliers", "velocity_jump", "displacement_jump"):
            compare(getattr(values, name)[k], make(getattr(history, name)))
        for (name, _), s in zip(history.keys, history.subdomains):
            if s is None:
                with pytest.raises(KeyError, match="was not recorded"):
                    values[name]
                continue
            for kind in ("u", "v", "a", "deformation", "force"):
                x = getattr(s, kind)
                row = getattr(values[name], kind)
                assert (x is None) == (row is None)
                if x is not None:
                    compare(row[k], make(x))
            assert values[name].outputs.keys() == s.outputs.keys()
            for output, x in s.outputs.items():
                compare(values[name].outputs[output][k], make(x))
            np.testing.assert_array_equal(values[name].dofs, s.dofs)


def compare(row, expected):
    # sums of at most 301 rows, which NumPy may add in an order that depends on their layout
    rounding = 1e-12 * (1.0 + np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(row, expected, rtol=0.0, atol=rounding)


@pytest.mark.parametrize("reduce", EXPECTED)
@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("threads", [1, 2])
def test_values_are_the_reductions_of_the_histories(reduce, options, threads):
    cases, chosen = shaken(19), OPTIONS[options]
    histories = tower().run_each(cases, steps=STEPS, **chosen)
    values = tower(threads).run_each(cases, steps=STEPS, reduce=reduce, **chosen)
    assert len(values) == 19
    check(values, histories, EXPECTED[reduce])
    assert np.unique(values["frame"].u[:, -1]).size == 19  # no case has the row of another


def test_peaks_and_last_values_are_bitwise_those_of_the_histories():
    cases = shaken(9)
    histories = tower().run_each(cases, steps=STEPS)
    peaks = tower().run_each(cases, steps=STEPS, reduce="peak")
    for k, history in enumerate(histories):
        np.testing.assert_array_equal(peaks["frame"].u[k], history["frame"].peak().u)


def test_cases_that_run_alone_are_reduced_too():
    cases = [{"force": {"frame": lambda t, k=k: [0.0, 0.0, k * np.sin(t)]}} for k in range(4)]
    histories = tower().run_each(cases, steps=STEPS)
    values = tower().run_each(cases, steps=STEPS, reduce="peak")
    check(values, histories, EXPECTED["peak"])


def test_a_failed_case_has_nan_and_the_others_their_values():
    def fails(t):
        if t > 0.1:
            raise ZeroDivisionError("too late")
        return [0.0, 0.0, 0.0]

    cases = shaken(4)
    cases[2] = {"force": {"frame": fails}}
    with pytest.raises(pm.CasesError, match=r"1 of 4 cases failed, first cases\[2\]") as caught:
        tower().run_each(cases, steps=STEPS, reduce="peak")
    values = caught.value.values
    assert np.all(np.isnan(values["frame"].u[2])) and caught.value.histories == [None] * 4
    del cases[2]
    rest = tower().run_each(cases, steps=STEPS, reduce="peak")
    np.testing.assert_array_equal(np.delete(values["base"].v, 2, axis=0), rest["base"].v)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"reduce": "mean"}, "reduce must be one of 'peak', 'last', 'sum', or None, got 'mean'"),
        ({"reduce": "peak", "energy": True}, "reduce must be None with energy, got 'peak'"),
        ({"reduce": "last", "record_to": ["a.h5"]}, "reduce must be None with record_to"),
    ],
)
def test_wrong_reductions_are_refused_before_the_first_case(options, message):
    with pytest.raises(ValueError, match=message):
        tower().run_each([{}], steps=1, **options)


@pytest.mark.gate
def test_values_are_a_dataset_over_cases():
    pytest.importorskip("xarray")
    values = tower().run_each(shaken(5), steps=STEPS, reduce="peak", **OPTIONS["some"])
    data = values.to_xarray()
    assert data["frame_u"].dims == ("case", "frame_dof") and data.sizes["case"] == 5
    roof = data["frame_u"].sel(frame_dof="roof")
    np.testing.assert_array_equal(roof, values["frame"].u[:, values["frame"].column("roof")])
    np.testing.assert_array_equal(data["frame_drift"][:, 0], values["frame"].outputs["drift"][:, 0])
    assert data.attrs["reduce"] == "peak" and data["multipliers"].dims == ("case", "constraint")
