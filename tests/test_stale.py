"""An extension built in place of other sources than the present ones is not imported."""

import os
import shutil
from pathlib import Path

import pytest
import waits

from pmalpha import stale


@pytest.fixture
def root(tmp_path):
    for folder in ("core/algebra", "binding"):
        (tmp_path / "csrc" / folder).mkdir(parents=True)
    (tmp_path / "csrc/core/algebra/lu.c").write_text("int a;\n")
    (tmp_path / "csrc/binding/module.c").write_text("int b;\n")
    stale.write_stamp(tmp_path)
    return tmp_path


def later(path, text):
    path.write_text(text)
    ahead = (path.parent.stat().st_mtime_ns) + 10**9
    os.utime(path, ns=(ahead, ahead))


def test_sources_that_changed_are_noticed(root):
    stale.require_present_build(root)
    lu = root / "csrc/core/algebra/lu.c"
    later(lu, "int c;\n")
    with pytest.raises(ImportError, match="built of other sources.*make test"):
        stale.require_present_build(root)
    later(lu, "int a;\n")  # as they were, with another time
    stale.require_present_build(root)


def test_a_file_that_is_new_is_noticed(root):
    later(root / "csrc/core/new.h", "")
    with pytest.raises(ImportError):
        stale.require_present_build(root)


def test_without_sources_or_stamp_nothing_is_compared(root, tmp_path):
    (root / stale.STAMP).unlink()
    later(root / "csrc/core/new.h", "")
    stale.require_present_build(root)
    stale.require_present_build(tmp_path / "elsewhere")


def test_pytest_ends_with_the_message_of_a_stale_build(root):
    tests = Path(__file__).parent
    for folder in ("pmalpha", "tests"):
        (root / folder).mkdir()
    shutil.copy(stale.__file__, root / "pmalpha")
    package = (
        "from . import stale",
        "stale.require_present_build()",
        "AccuracyWarning = UserWarning",
    )
    (root / "pmalpha/__init__.py").write_text("\n".join(package))
    shutil.copy(tests / "conftest.py", root / "tests")
    shutil.copy(tests.parent / "pyproject.toml", root)
    (root / "tests/test_x.py").write_text("import pmalpha\n\ndef test_x():\n    pass\n")
    program = f"""
        import os, sys
        for name in [x for x in sys.modules if x.split(".")[0] == "pmalpha"]:
            del sys.modules[name]
        os.chdir({str(root)!r})
        sys.path.insert(0, os.getcwd())
        import pytest
        sys.exit(pytest.main(["tests/test_x.py"]))
    """
    done = waits.program(program)
    assert done.returncode == 0, done.stdout + done.stderr
    later(root / "csrc/core/algebra/lu.c", "int c;\n")
    done = waits.program(program)
    shown = (done.stdout + done.stderr).splitlines()
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert len(shown) == 1 and "built of other sources" in shown[0] and "make test" in shown[0]
