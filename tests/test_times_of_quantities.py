"""Every recorded array has the times of its rows: at other times, in tables, files and pictures."""

import warnings

import numpy as np
import pytest

import pmalpha as pm


def two_tied(seed, coupling):
    """Two random subdomains of two dofs, tied at one of them."""
    rng = np.random.default_rng(seed)
    subdomains = []
    for name, substeps in zip("ab", rng.permutation([1, rng.integers(1, 5)])):
        A = rng.normal(size=(2, 2))
        how = dict(scheme=pm.Newmark(), substeps=int(substeps), name=name)
        v0 = np.array([0.0, rng.normal()])
        M, K = rng.uniform(0.5, 2.0, 2), 5.0 * A @ A.T + 5.0 * np.eye(2)
        subdomains.append(pm.Subdomain(M, K, v0=v0, **how))
    ties = pm.tie(subdomains[0], 0, subdomains[1], 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pm.AccuracyWarning)  # random steps, compared with no motion
        return pm.Coupler(subdomains, ties, dt=0.1, coupling=coupling).run(
            2.0, every=int(rng.integers(1, 4))
        )


def jump(history):
    """Its velocity jump from the recorded velocities, at macro times."""
    t = history.macro_times
    a, b = (np.interp(t, s.t, s.v[:, 0]) for s in history.subdomains)
    return a - b


@pytest.mark.parametrize("seed", range(8))
def test_velocity_jumps_of_mean_coupling_are_at_macro_times_wherever_they_go(tmp_path, seed):
    history = two_tied(seed, "mean")
    expected = jump(history)
    # of velocities of order 1, by sums of a few terms
    close = dict(rtol=0.0, atol=1e-14)
    assert np.abs(expected).max() > 1e-6  # a shift by half a step is seen
    np.testing.assert_allclose(history.velocity_jump[:, 0], expected, **close)
    times = np.sort(np.random.default_rng(seed).uniform(0.0, history.macro_times[-1], 30))
    histories = [history]
    for name in ("run.npz", "run.h5"):
        history.save(tmp_path / name)
        histories.append(pm.History.load(tmp_path / name))
    for one in histories:
        again = one.resampled(times)
        between = np.interp(times, one.macro_times, expected)
        np.testing.assert_allclose(again.velocity_jump[:, 0], between, **close)
        middles = one.multiplier_times
        assert middles[-1] == pytest.approx(one.macro_times[-1] - 0.05)
        lam = np.interp(times, middles, one.multipliers[:, 0])
        np.testing.assert_allclose(again.multipliers[:, 0], lam, rtol=1e-12, atol=1e-12)


def test_tables_of_mean_coupling_have_an_index_for_each_axis():
    pytest.importorskip("pandas")
    history = two_tied(1, "mean")
    tables = history.to_pandas()
    np.testing.assert_array_equal(tables["velocity_jump"].index, history.macro_times)
    np.testing.assert_array_equal(tables["interface"].index, history.multiplier_times)
    assert [x for x, _ in tables["interface"].columns] == ["multipliers"]
    tables = two_tied(1, "macro").to_pandas()
    assert [x for x, _ in tables["interface"].columns] == ["multipliers", "velocity_jump"]
    assert "velocity_jump" not in tables


@pytest.mark.parametrize("coupling", ["mean", "macro"])
def test_variables_of_xarray_have_the_coordinate_of_their_axis(coupling):
    pytest.importorskip("xarray")
    data = two_tied(2, coupling).to_xarray()
    axis = "macro_times" if coupling == "mean" else "multiplier_times"
    assert data.velocity_jump.dims == (axis, "constraint")
    assert data.multipliers.dims == ("multiplier_times", "constraint")


def test_panels_have_the_times_of_what_they_show():
    pytest.importorskip("matplotlib")
    from matplotlib import pyplot as plt

    history = two_tied(3, "mean")
    figure = history.plot().figure
    panels = {ax.get_ylabel().split("(")[0].strip(): ax.lines[0] for ax in figure.axes}
    plt.close(figure)
    np.testing.assert_array_equal(panels["velocity\njump"].get_xdata(), history.macro_times)
    np.testing.assert_array_equal(panels["multiplier"].get_xdata(), history.multiplier_times)


@pytest.mark.parametrize("coupling", ["mean", "macro"])
def test_arrays_of_a_file_have_the_name_of_their_times(tmp_path, coupling):
    h5py = pytest.importorskip("h5py")
    two_tied(4, coupling).save(tmp_path / "run.h5")
    with h5py.File(tmp_path / "run.h5") as file:
        found = {x: file[x].attrs["times"] for x in ("velocity_jump", "multipliers", "a/u")}
        assert "times" not in file["a/dofs"].attrs
    axis = "macro_times" if coupling == "mean" else "multiplier_times"
    assert found == {"velocity_jump": axis, "multipliers": "multiplier_times", "a/u": "t"}


# ---- contacts ------------------------------------------------------------------------------------


def falling(seed):
    """A mass that falls on the ground, or on another one, under its weight."""
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.5, 3.0, 2)
    balls = [
        pm.Subdomain([m], [0.0], scheme=pm.Newmark(), force=[-10.0 * m], u0=[height], name=name)
        for m, height, name in zip(masses, (0.3, 0.1 * seed), "ab")
    ]
    contacts = [pm.contact(balls[0], 0, name="a"), pm.contact(balls[1], 0, name="b")]
    history = pm.Coupler(balls, contacts, dt=0.01, coupling="gc").run(
        1.0, every=None if seed % 2 else 3
    )
    return masses, history


@pytest.mark.parametrize("seed", range(6))
def test_impulses_at_other_times_are_the_change_of_momentum(seed):
    masses, history = falling(seed)
    rng = np.random.default_rng(seed)
    levels = history.macro_times
    some = np.union1d(rng.choice(len(levels), 12, replace=False), [0, len(levels) - 1])
    again = history.resampled(levels[some])
    for m, name in zip(masses, "ab"):
        # m (v1 - v0) = sum of P - 10 m (t1 - t0), which each step satisfies
        v, t = history[name].v[some, 0], levels[some]
        expected = np.append(0.0, m * np.diff(v) + 10.0 * m * np.diff(t))
        found = again.contacts[name].impulse[:, 0]
        assert expected.max() > 1.0  # there are impacts
        np.testing.assert_allclose(found, expected, atol=1e-12 * m * 10.0)
        np.testing.assert_array_equal(again.contacts[name].t, levels[some])
    # at any times with the ends the sum stays: 1e-12, rounding of a hundred terms
    times = np.concatenate([[0.0], np.sort(rng.uniform(0.0, levels[-1], 40)), levels[-1:]])
    sums = [x.contact_impulses.sum(axis=0) for x in (history, history.resampled(times))]
    np.testing.assert_allclose(sums[1], sums[0], rtol=1e-12)


def test_the_force_of_an_impact_stays_where_it_was():
    _, history = falling(5)
    contact = history.contacts["a"]
    impact = contact.t[np.argmax(contact.impulse[:, 0])]
    again = history.resampled(np.linspace(0.0, 1.0, 51)).contacts["a"]
    # steps of 0.01 in times 0.02 apart: half the mean force, in the interval of the impact
    k = int(np.argmax(again.impulse[:, 0]))
    assert again.t[k - 1] < impact <= again.t[k] + 1e-9
    assert again.force.max() <= contact.force.max()
    # and gaps are those of the motion
    t = again.t
    np.testing.assert_allclose(again.gap[:, 0], np.interp(t, contact.t, contact.gap[:, 0]))


def test_a_dataset_has_contacts_too():
    pytest.importorskip("xarray")
    _, history = falling(1)
    data = history.to_xarray()
    assert data.contact_impulses.dims == ("multiplier_times", "contact_row")
    assert data.contact_gaps.dims == ("multiplier_times", "contact")
