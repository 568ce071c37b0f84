"""Sound and realistic runs have no warning of any kind, gains of energy above a tenth have one.

The problems are those of watched_runs.py, of which benchmarks/surveys/warned_runs.py tries any
number.
"""

import warnings

import pytest
import watched_runs

import pmalpha as pm

SOUND = range(36)


@pytest.mark.parametrize(
    ("make", "seeds"), [(watched_runs.sound, SOUND), (watched_runs.realistic, range(20))]
)
def test_sound_runs_have_no_warning(make, seeds):
    for seed in seeds:
        run = make(seed)
        before, during = run.warned()
        assert before + during == [], f"seed {seed}, {run.kind}"


def test_sound_runs_are_of_all_kinds():
    words = " ".join(watched_runs.sound(seed).kind for seed in SOUND).split()
    for kinds in (watched_runs.COUPLINGS, watched_runs.LAWS, watched_runs.LOADS, "123"):
        assert set(kinds) <= set(words)


@pytest.mark.parametrize(
    # in cut chains up to a third may go through the tie while the subdomain is no faster
    ("make", "seeds", "most", "fewest"),
    [(watched_runs.thrown, 64, 0.1, 15), (watched_runs.grown, 24, 0.35, 4)],
)
def test_gains_of_energy_are_announced(make, seeds, most, fewest):
    gained = 0
    for seed in range(seeds):
        run, gain_of = make(seed)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                gain = gain_of(run.make().run(steps=run.steps))
            except (pm.InstabilityError, pm.ConvergenceError):
                continue  # which is an announcement too
        announced = any(
            "have added energy" in str(x.message) or "too stiff" in str(x.message) for x in caught
        )
        if gain > most:
            gained += 1
            assert announced, f"seed {seed}, {run.kind}: {gain:.3g} of its energy in silence"
        if gain < 0.0:
            assert not announced, f"seed {seed}, {run.kind}: announced, and lost {-gain:.3g}"
    assert gained > fewest
