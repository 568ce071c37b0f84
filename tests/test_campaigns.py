"""A short form of each campaign."""

import shutil
import sys
import sysconfig

import campaign_disk
import campaign_doubling
import campaign_files
import campaign_frozen
import campaign_input
import campaign_memory
import campaign_modes
import campaign_remote
import campaign_signals
import campaign_soak
import campaign_stalls
import campaign_states
import pytest
import waits
from campaign import tried

pytestmark = pytest.mark.gate


def test_ctrl_c_at_any_instant_leaves_the_last_macro_step_and_its_history():
    counts = tried(campaign_signals.attempt, range(3))
    # an interrupt after less than the duration of a call, on average, hits most calls
    assert counts["moved"] > 10 and counts["not moved"] > 10


def test_odd_input_works_or_is_refused_by_name():
    counts = campaign_input.campaign(most=120, seconds=600.0)
    assert counts["works"] > 10 and counts["TypeError"] > 10 and counts["ValueError"] > 10


def test_damaged_and_forged_files_are_refused_by_name():
    counts = campaign_files.campaign(most=120, seconds=600.0)
    assert counts["works"] > 5 and counts["ValueError"] > 50


@pytest.mark.skipif(sys.platform != "linux", reason="forks, limits memory and sizes of files")
def test_files_that_others_write_replace_or_cut_off_mix_and_lose_nothing():
    pytest.importorskip("h5py")
    counts = tried(campaign_disk.attempt, range(2 * len(campaign_disk.TRIALS)))
    assert campaign_disk.faults(counts) == {}
    assert counts["replaced_while_loaded: loaded"] == 200
    assert counts["interrupted_save: KeyboardInterrupt"] > 10


@pytest.mark.skipif(sys.platform != "linux", reason="compiled with the sanitizers of gcc")
def test_damaged_frozen_models_are_opened_or_refused_without_a_fault():
    counts = campaign_frozen.campaign(range(1), copies=100)
    assert counts["models"] > 25
    for kind in campaign_frozen.KINDS:
        assert counts[f"{kind}: copies"] == 100 * counts["models"]
        assert 100 < counts[f"{kind}: stepped"] <= counts[f"{kind}: opened"]
    # a change of a number of the data is no damage; a quarter has a check sum that is wrong
    assert counts["bytes: opened"] < 0.5 * counts["bytes: copies"]
    assert counts["states: opened"] < counts["states: copies"]


def test_checkpoints_with_another_number_are_refused_or_gone_on_from():
    counts = campaign_states.campaign(range(600))
    assert counts["refused"] > 30 and counts["stepped"] > 300
    assert counts["ended by an exception"] > 0


def test_strangers_on_a_connection_end_it_in_time():
    counts = campaign_remote.campaign(most=200, seconds=600.0)
    assert counts["works"] > 20 and counts["ConnectionError"] > 20


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot be stopped there")
def test_a_stopped_process_sends_its_specimen_no_burst_of_commands():
    counts = tried(campaign_stalls.attempt, range(4))
    assert counts["continue: ran"] == 2 and counts["missed"] > 0


@pytest.mark.skipif(sys.platform != "linux", reason="forks, and interrupts by timers")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_forks_and_ctrl_c_leave_blas_its_threads_and_decayed_motions_are_zero():
    counts = tried(campaign_modes.attempt, range(4 * len(campaign_modes.TRIALS)))
    assert campaign_modes.faults(counts) == {}
    assert counts["forked: done"] == 40 and counts["interrupted: interrupts"] == 160
    assert counts["decayed: ran"] > 0 and counts["decayed: ended by an exception"] > 0


def test_nothing_grows_in_many_steps_and_couplers_that_their_callbacks_hold_are_collected():
    counts = campaign_soak.campaign(seconds=0.0, least=4, steps=80)
    # from the third of four rounds on memory may not grow
    assert counts["macro steps"] == 24 * (120 + 100 + (20 if campaign_soak.HDF5 else 0))
    assert counts["couplers"] == 24


@pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("cc"), reason="needs a C compiler and LD_PRELOAD"
)
@pytest.mark.skipif(
    bool(sysconfig.get_config_var("Py_GIL_DISABLED")),
    reason="a Python without the GIL cannot take its memory from malloc",
)
def test_an_allocation_that_fails_is_a_memory_error_and_changes_nothing():
    # the first five of each call, and some of the others
    kinds = ["callbacks", "macro", "mean"]
    found = campaign_memory.campaign(kinds, stride=997, first=5, seconds=waits.LIMIT)
    assert "'MemoryError': " in found


@pytest.mark.skipif(sys.platform != "linux", reason="forks and limits memory")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_twice_the_size_of_a_file_takes_at_most_two_and_a_half_times_as_long():
    counts = campaign_doubling.campaign(campaign_doubling.CASES, most=200_000)
    assert sum(counts.values()) == len(campaign_doubling.CASES)
    assert counts["compared"] >= 2  # others of this size take less than can be compared
