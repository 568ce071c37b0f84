"""Files that version 0.2.0 wrote can be read, and a run goes on from them.

`python tests/test_stored_files.py FOLDER` writes those of the version that is installed. Those in
tests/data were written by 0.2.0 on x86-64, and are not written again.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

import pmalpha as pm

DATA = Path(__file__).parent / "data"
VERSION = "0.2.0"
# Of values of order one after twenty substeps; other processors round other sums.
TOLERANCE = 1e-10
KINDS = ("pm", "macro", "mean")  # couplings


def plastic(t, u, v, q):
    """Elastic, perfectly plastic: q the plastic displacement, yield force 1."""
    trial = 30.0 * (u - q)
    force = np.clip(trial, -1.0, 1.0)
    return force, np.diag(np.where(abs(trial) < 1.0, 30.0, 0.0)), None, u - force / 30.0


def coupler(kind):
    """A frame of three masses and a fine one of two: springs and a load."""
    K = 20.0 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    soft = pm.GeneralizedAlpha(0.5)
    record = np.sin(0.7 * np.arange(60.0))
    springs = [
        pm.Bilinear([0], k=15.0, fy=0.5, hardening=0.1),
        pm.CubicSpring([(1, 2)], k=3.0, k3=40.0),
    ]
    if kind == "macro":
        laws = {"restoring": springs + [pm.BoucWen([2], k=10.0, fy=0.4)]}
    else:
        laws = {"internal": springs + [pm.InternalForce(plastic, history=np.zeros(3))]}
    frame = pm.Subdomain(
        np.ones(3),
        K,
        C=None if kind == "mean" else 0.01 * K,  # which grows there
        scheme=soft,
        force=pm.BaseAcceleration(record, np.ones(3), np.ones(3), dt=0.03),
        v0=np.full(3, 4.0),
        name="frame",
        **laws,
    )
    fine = pm.Subdomain(
        [0.5, 0.3],
        30.0 * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        scheme=pm.GeneralizedAlpha(0.6, explicit=True),
        substeps=4,
        v0=np.full(2, 4.0),
        name="fine",
    )
    return pm.Coupler([frame, fine], [pm.tie(frame, [2], fine, [0])], dt=0.02, coupling=kind)


def arrays(history):
    """Whatever a History holds of a run, but the number of iterations, by a name for each array."""
    found = {"multipliers": history.multipliers, "multiplier_times": history.multiplier_times}
    found |= {name: getattr(history, name) for name in ("velocity_jump", "displacement_jump")}
    for part in history.subdomains:
        for name in ("t", "u", "v", "a", "q"):
            if getattr(part, name, None) is not None:
                found[f"{part.name}.{name}"] = getattr(part, name)
    for name in ("kinetic", "strain", "dissipated", "external", "interface", "balance"):
        found[f"energy.{name}"] = getattr(history.energy, name)
    return found


def stored(kind, ending):
    return DATA / f"{kind}-{VERSION}{ending}"


@pytest.mark.parametrize("ending", [".history.npz", ".history.h5"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_history_that_0_2_0_stored_is_the_one_that_this_version_makes(kind, ending):
    if ending.endswith("h5"):
        pytest.importorskip("h5py")
    read, made = pm.History.load(stored(kind, ending)), coupler(kind).run(steps=5, energy=True)
    expected, actual = arrays(made), arrays(read)
    assert actual.keys() == expected.keys()
    for name, values in actual.items():
        np.testing.assert_allclose(values, expected[name], atol=TOLERANCE, rtol=0, err_msg=name)
    assert [x.name for x in read.subdomains] == ["frame", "fine"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_goes_on_from_a_checkpoint_that_0_2_0_stored(kind):
    there, whole = coupler(kind), coupler(kind)
    there.load(stored(kind, ".checkpoint.npz"))
    whole.step(5)
    assert there.step_count == 5
    expected = arrays(whole.run(steps=5, energy=True))
    for name, values in arrays(there.run(steps=5, energy=True)).items():
        np.testing.assert_allclose(values, expected[name], atol=TOLERANCE, rtol=0, err_msg=name)


def test_a_history_of_removed_drift_is_read_and_its_checkpoint_is_refused_by_name():
    """`drift="removed"` ended with 0.3: displacements were tied at the ends of macro steps."""
    history = pm.History.load(stored("gc", ".history.npz"))
    assert np.abs(history.displacement_jump).max() < 1e-15 < np.abs(history.multipliers).max()
    with pytest.raises(ValueError, match=r"drift \(removed in the file, not given here\)"):
        coupler("macro").load(stored("gc", ".checkpoint.npz"))


def write(folder):
    for kind in KINDS:
        made = coupler(kind)
        history = made.run(steps=5, energy=True)
        for ending in (".history.npz", ".history.h5"):
            history.save(folder / f"{kind}-{pm.__version__}{ending}")
        made.save(folder / f"{kind}-{pm.__version__}.checkpoint.npz")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
