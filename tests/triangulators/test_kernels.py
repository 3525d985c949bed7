import os
import shutil
import subprocess
import sys
import time
import warnings
from functools import partial
from pathlib import Path

import pytest

from tests.paths import ROOT, run_python
from triangulators.compute import compiled_files as files
from triangulators.compute import storing

INNER = """
from triangulators.compute.kernels import njit

@njit
def inner(x):
    return x + {added}
"""

OUTER = """
from triangulators.compute.kernels import njit
from triangulators.inner import inner

@njit
def outer(x):
    return 10 * inner(x)

if __name__ == "__main__":
    from triangulators.outer import outer as kernel
    print(kernel(1))
"""


@pytest.fixture
def sources(tmp_path, monkeypatch) -> Path:
    """A package of two kernels, one of which calls the other, in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    package = tmp_path / "triangulators"
    (package / "compute").mkdir(parents=True)
    for folder in (package, package / "compute"):
        (folder / "__init__.py").write_text("")
    for name in ("kernels.py", "storing.py", "compiled_files.py"):
        shutil.copy(ROOT / "triangulators" / "compute" / name, package / "compute")
    (package / "inner.py").write_text(INNER.format(added=1))
    (package / "outer.py").write_text(OUTER)
    return package


TRACED = """
from numba.core import event
from triangulators.outer import outer as kernel

class Tracer(event.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"].py_func.__name__, flush=True)
        time.sleep(1)

    def on_end(self, event):
        pass

import time
event.register("numba:compile", Tracer())
kernel(1)
"""


def test_two_processes_compile_kernel_once(sources):
    command = [sys.executable, "-c", TRACED]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    printed = [line for process in both for line in process.communicate()[0].split()]
    assert [process.returncode for process in both] == [0, 0]
    assert sorted(printed) == ["inner", "outer"]


def test_change_in_called_module_recompiles(sources, tmp_path):
    call_kernel = partial(run_python, "-m", "triangulators.outer", cwd=tmp_path)
    cache = tmp_path / "cache"
    assert call_kernel().stdout == "20\n"
    files_before = set(cache.rglob("*.nbc"))
    assert {file.name.partition("-")[0] for file in files_before} == {"inner", "outer"}
    (sources / "inner.py").write_text(INNER.format(added=4))
    os.utime(sources / "inner.py", (1, 1))  # older than what was compiled, as after a checkout
    assert call_kernel().stdout == "50\n"
    assert files_before < set(cache.rglob("*.nbc"))


@pytest.mark.parametrize(("edited", "changed"), [("a", "a"), ("b", "ab"), ("c", "abc"), ("d", "d")])
def test_digest_changes_for_importing_modules_only(tmp_path, monkeypatch, edited, changed):
    def compute_digests():
        for name in ("compute_digest", "_read_source", "_find_imports", "_find_file"):
            getattr(files, name).cache_clear()
        return {name: files.compute_digest(package / f"{name}.py") for name in "abcd"}

    monkeypatch.setattr(files, "SOURCES", tmp_path)
    package = tmp_path / "triangulators"
    package.mkdir()
    (package / "a.py").write_text("from triangulators import (\n    b,\n)\n")
    (package / "b.py").write_text("if True:\n    from triangulators.c import f\n")
    (package / "c.py").write_text("def f(): ...\n")
    (package / "d.py").write_text("import numpy\n")
    before = compute_digests()
    with (package / f"{edited}.py").open("a") as file:
        file.write("# changed\n")
    after = compute_digests()
    assert {name for name in "abcd" if before[name] != after[name]} == set(changed)


def test_damaged_files_are_recompiled(tmp_path):
    stored = storing._Files(tmp_path / "new", "kernel")
    assert stored.load("key") is None
    stored.save("key", [1, 2])
    assert stored.load("key") == [1, 2]
    assert stored.load("another") is None
    (file,) = (tmp_path / "new").iterdir()
    content = file.read_bytes()
    for damaged in (b"", content[: len(content) // 2], b"x" + content[1:]):
        file.write_bytes(damaged)
        assert stored.load("key") is None


GONE, OTHER = "gone-0123456789abcdef", "other-0123456789abcdef"


@pytest.mark.parametrize("untrusted", ["file", "folder", "link", "folder above"])
def test_untrusted_code_is_not_loaded(tmp_path, monkeypatch, untrusted):
    """Loading a pickle executes code."""
    monkeypatch.setattr(files, "cache_folder", lambda: tmp_path / "compiled" / "numba")
    folder = files.cache_folder() / OTHER
    stored = storing._Files(folder, "kernel")
    stored.save("key", [1, 2])
    assert stored.load("key") == [1, 2]
    (file,) = folder.iterdir()
    if untrusted == "link":
        file.rename(tmp_path / "elsewhere")
        file.symlink_to(tmp_path / "elsewhere")
    else:
        {"file": file, "folder": folder, "folder above": tmp_path}[untrusted].chmod(0o777)
    files.is_trusted_folder.cache_clear()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        assert stored.load("key") is None
    assert len(warned) == ("folder" in untrusted)
    tmp_path.chmod(0o700)
    files.is_trusted_folder.cache_clear()


def test_saved_code_is_trusted_for_any_umask(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "cache_folder", lambda: tmp_path / "compiled" / "numba")
    before = os.umask(0)
    try:
        stored = storing._Files(files.cache_folder() / OTHER, "kernel")
        stored.save("key", [1])
    finally:
        os.umask(before)
    assert stored.load("key") == [1]


def test_remove_old_keeps_current_code(tmp_path, monkeypatch):
    numba_folder = tmp_path / "compiled" / "numba"
    monkeypatch.setattr(files, "cache_folder", lambda: numba_folder)
    source = ROOT / "triangulators/compute/kernels.py"
    current = f"triangulators.compute.kernels-{files.compute_digest(source)}"
    past = time.time() - 2 * files.MAX_UNUSED_S
    for name, when in ((current, past), (GONE, past), (OTHER, None), ("mine-1", past)):
        (numba_folder / name).mkdir(parents=True)
        (numba_folder / name / "kernel.nbc").write_bytes(b"code")
        if when is not None:
            os.utime(numba_folder / name / "kernel.nbc", (when, when))
    assert files.measure_cache().files == 4
    assert files.remove_old_code() == 1
    assert {folder.name for folder in numba_folder.iterdir()} == {current, OTHER, "mine-1"}
