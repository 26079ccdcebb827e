"""Packages that only some commands need: without them the rest works, and a sentence says how."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from hertzloop.common.optional_dependencies import EXTRAS
from tests.hertzloop.own_laws import ROOT

MAIN = "from hertzloop.__main__ import main; main()"


def without(
    packages: str, *words: str, cwd: Path, code: str = MAIN
) -> subprocess.CompletedProcess[str]:
    """Run a command, or code, where packages, apart by spaces, are not installed."""
    before = f"import sys; sys.modules |= dict.fromkeys({packages.split()!r}); "
    before += f"sys.argv = ['hertzloop', *{words!r}]\n"
    return subprocess.run(
        [sys.executable, "-c", before + code], cwd=cwd, capture_output=True, text=True, timeout=120
    )


@pytest.mark.full
@pytest.mark.parametrize(
    ("package", "extra", "words"),
    [
        ("h5py", "h5", "export none.mcap -o a.h5"),
        ("cryptography", "hosts", "node keys d --hosts plant=a,controller=b,recorder=c"),
        ("jinja2", "charts", "report none.mcap -o page"),
        ("distributed", "dask", "sweep --over sensors.bits=8 --dask tcp://h:8786"),
    ],
)
def test_a_missing_package_is_named(package: str, extra: str, words: str, tmp_path: Path) -> None:
    done = without(package, *words.split(), cwd=tmp_path)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
    assert f"needs {package}" in done.stderr
    assert f"pip install 'hertzloop[{extra}]'" in done.stderr


def test_all_that_tune_needs_is_named_at_once(tmp_path: Path) -> None:
    done = without("matplotlib pymoo", "tune", "aluminium-3mm", cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert " ".join(done.stderr.split()) == (
        "error: this needs matplotlib and pymoo, which are not installed: "
        "pip install 'hertzloop[charts,tune]'"
    )


NOT_IN_THE_BASE = " ".join(EXTRAS)


def test_the_python_interface_needs_no_extra_until_one_is_asked_for(tmp_path: Path) -> None:
    page = ROOT / "docs" / "how-to" / "python.md"
    first, second = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)[:2]
    assert "truth" in second
    done = without(NOT_IN_THE_BASE, cwd=tmp_path, code=first + "run.truth")
    assert "us, " in done.stdout
    assert "Metrics of A and B" in done.stdout
    assert done.stderr.splitlines()[-1] == (
        "ModuleNotFoundError: this needs xarray, which is not installed: "
        "pip install 'hertzloop[python]'"
    )


# The workflow that `law new --with-check` writes installs no extra.
REQUIREMENTS = """
hertzloop.law = "force_feedback"
[[requirement]]
name = "a"
scene = "aluminium-3mm"
goal = "plate_energy_db <= -0.1"
phases = 1
set = { "run.duration_s" = 0.002 }
"""


@pytest.mark.full
def test_runs_exports_and_checks_need_no_extra(tmp_path: Path) -> None:
    (tmp_path / "requirements.toml").write_text(REQUIREMENTS)
    for words in (
        "run --transport compiled --set run.duration_s=0.002 -o a.mcap",
        "export a.mcap -o a.csv",
        "export a.mcap -o a.parquet",
        "scene modes aluminium-3mm -o modes.csv",
        "budget --check requirements.toml",
    ):
        done = without(NOT_IN_THE_BASE, *words.split(), cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert "1 of 1 requirements hold" in done.stdout
