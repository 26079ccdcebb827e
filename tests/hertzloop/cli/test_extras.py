"""Packages that only some commands need: without them the rest works, and a sentence says how."""

import re
import subprocess
from pathlib import Path

import pytest

from hertzloop.common.optional_dependencies import EXTRAS
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT

MAIN = "from hertzloop.__main__ import main; main()"


def without(
    packages: str, *words: str, cwd: Path, text: str = MAIN, code: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run a command, or a program, where packages, apart by spaces, are not installed."""
    before = f"import sys; sys.modules |= dict.fromkeys({packages.split()!r}); "
    before += f"sys.argv = ['hertzloop', *{words!r}]\n"
    return python("-c", before + text, cwd=cwd, code=code)


@pytest.mark.full
@pytest.mark.parametrize(
    ("packages", "extra", "words"),
    [
        ("cryptography", "hosts", "node keys d --hosts plant=a,controller=b,recorder=c"),
        ("jinja2", "charts", "report none.mcap -o page"),
        ("distributed", "dask", "sweep --over sensors.bits=8 --dask tcp://h:8786"),
        ("matplotlib pymoo", "charts,tune", "tune aluminium-3mm"),
    ],
)
def test_all_missing_packages_are_named(packages, extra, words, tmp_path):
    done = without(packages, *words.split(), cwd=tmp_path, code=2)
    assert "Traceback" not in done.stderr
    said = " ".join(done.stderr.split())
    assert f"needs {packages.replace(' ', ' and ')}" in said
    assert f"pip install 'hertzloop[{extra}]'" in said


NOT_IN_THE_BASE = " ".join(EXTRAS)


@pytest.mark.full
def test_the_python_interface_needs_no_extra_until_one_is_asked_for(tmp_path):
    page = ROOT / "docs" / "how-to" / "python.md"
    first, second = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)[:2]
    assert "truth" in second
    done = without(NOT_IN_THE_BASE, cwd=tmp_path, text=first + "run.truth", code=1)
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
def test_runs_exports_and_checks_need_no_extra(tmp_path):
    (tmp_path / "requirements.toml").write_text(REQUIREMENTS)
    for words in (
        "run --transport compiled --set run.duration_s=0.002 -o a.mcap",
        "export a.mcap -o a.csv",
        "export a.mcap -o a.parquet",
        "scene modes aluminium-3mm -o modes.csv",
        "budget --check requirements.toml",
    ):
        done = without(NOT_IN_THE_BASE, *words.split(), cwd=tmp_path)
    assert "1 of 1 requirements hold" in done.stdout
