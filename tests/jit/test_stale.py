"""Compiled code is never older than its sources, whatever a script imports first."""

import ast
import os
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from hertzloop.common.jit.folder import kernel_sources
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT

LINKED = ("common", "plant", "sensors", "controller", "bus", "recordings")  # from hertzloop/
FOLDERS = ("hertzloop", "benchmarks", *LINKED)

# A caller in one file, its callee in another; numba first, nothing of hertzloop.
SLOPES = """
import numba
from benchmarks.integrator_kernels import many_slopes
import numpy as np
print(many_slopes(np.zeros(4), np.ones(1), np.ones(1), 1.0, 1.0, 3))
print(many_slopes._cache.cache_path, dict(many_slopes.stats.cache_hits))
"""


def copy_to(folder: Path) -> Path:
    """A copy of the packages, to edit."""
    for name in FOLDERS:
        shutil.copytree(
            ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    return folder


def run(script: str, folder: Path, **more: str) -> str:
    """What a script prints that sees the copy in `folder`, with a kernel cache of its own."""
    own = {
        "PYTHONPATH": str(folder),
        "NUMBA_CACHE_DIR": str(folder / "cache"),
    }
    return python("-B", "-c", script, cwd=folder, env=os.environ | own | more).stdout


def edit(path: Path, pattern: str, new: str) -> None:
    """Replace what the pattern finds."""
    text, found = re.subn(pattern, new, path.read_text())
    assert found
    path.write_text(text)


@pytest.mark.full
def test_an_edited_callee_in_another_file_runs(tmp_path):
    folder = copy_to(tmp_path)
    before = run(SLOPES, folder).splitlines()[0]
    source = folder / "benchmarks" / "integrator_kernels.py"
    edit(source, r"out\[i\] = y\[n \+ i\]", "out[i] = y[n + i] + 7.0")
    after = run(SLOPES, folder).splitlines()[0]
    assert after != before
    assert after == run(SLOPES, folder, NUMBA_CACHE_DIR=str(folder / "empty")).splitlines()[0]


def test_functions_of_others_are_cached_where_they_were(tmp_path):
    script = """
import hertzloop.controller.kernels, numba
@numba.njit(cache=True)
def theirs(x):
    return x
print(theirs._cache.cache_path)
"""
    (tmp_path / "theirs.py").write_text(script)
    env = {name: text for name, text in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    env |= {"PYTHONPATH": str(ROOT), "HOME": str(tmp_path)}
    found = python(tmp_path / "theirs.py", env=env).stdout.strip()
    assert found == str(tmp_path / "__pycache__")


def test_the_digest_sees_all_that_is_compiled_in():
    """All folders of the wheel are looked through, and what kernels take from other files of
    ours, constants and types too, is in files that the digest covers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["packages"] == ["hertzloop"]
    assert all((ROOT / "hertzloop" / name).samefile(ROOT / name) for name in LINKED)
    sources = kernel_sources()
    assert {
        "hertzloop/plant/schemes/modal_kernels.py",
        "hertzloop/plant/schemes/registry.py",
        "hertzloop/common/jit/decorator.py",
    } <= set(sources)
    for file, text in sources.items():
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.ImportFrom) or file.startswith("hertzloop/common/jit/"):
                continue
            top, *rest = str(node.module).split(".")
            if top not in ("hertzloop", "benchmarks") or rest[:1] == ["common"]:
                continue
            for name in node.names:
                inner = "/".join((top, *rest, name.name)) + ".py"
                used = inner if (ROOT / inner).exists() else "/".join((top, *rest)) + ".py"
                assert used in sources, f"{file} takes {name.name} from {used}"
