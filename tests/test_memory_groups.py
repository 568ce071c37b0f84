"""What containers leave of the memory: groups of both versions, and those that contain them."""

import pytest

from pmalpha.memory import free_of_groups

MIB = 1 << 20


def group(folder, version, limit, used, cache=0):
    """A group of this version with a limit, or None, in MiB."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    none = str(0x7FFFFFFFFFFFF000)
    if version == 2:
        names, none = ("memory.max", "memory.current", "inactive_file"), "max"
    (folder / names[0]).write_text(f"{none if limit is None else limit * MIB}\n")
    (folder / names[1]).write_text(f"{used * MIB}\n")
    (folder / "memory.stat").write_text(f"anon 5\n{names[2]} {cache * MIB}\n")


@pytest.fixture
def mounted(tmp_path):
    """A function that returns what is available to a process in the group of this path."""

    def free(version, path):
        own = tmp_path / "own"
        own.write_text(f"9:cpu:/\n4:memory:{path}\n" if version == 1 else f"0::{path}\n")
        return free_of_groups(tmp_path / "groups", own)

    def root(version):
        return tmp_path / "groups" / ("memory" if version == 1 else "")

    free.root = root
    return free


@pytest.mark.parametrize("version", [1, 2])
def test_the_tightest_of_the_groups_that_contain_the_process_counts(mounted, version):
    root = mounted.root(version)
    group(root, version, None, 900)
    group(root / "outer", version, 100, 70, cache=5)
    group(root / "outer" / "inner", version, 500, 50)
    assert mounted(version, "/outer/inner") == 35 * MIB
    group(root / "outer" / "inner", version, 60, 50)
    assert mounted(version, "/outer/inner") == 10 * MIB
    assert mounted(version, "/") is None
    group(root / "outer", version, 100, 120)
    assert mounted(version, "/outer/inner") == 0


@pytest.mark.parametrize("version", [1, 2])
def test_a_container_that_sees_its_own_group_as_the_root_reads_that(mounted, version):
    group(mounted.root(version), version, 64, 4)
    for path in ("/", "/docker/abc", "/../other"):
        assert mounted(version, path) == 60 * MIB


def test_without_groups_nothing_is_known(tmp_path):
    assert free_of_groups(tmp_path, tmp_path / "none") is None
