"""A file that is not there: what is wrong, which name may be meant, and what to do."""

from pathlib import Path

import pytest

from hertzloop.common.missing_files import close_name, why_unreadable
from tests.commands import refused

READ = (
    "run mien.toml", "sweep mien.toml --over sensors.bits=8", "tune mien.toml", "margin mien.toml",
    "budget mien.toml", "scene check mien.toml", "export-plant mien.toml --out a.fmu",
    "inspect mien.mcap", "compare mien.mcap mine.mcap", "replay mien.mcap --save a.rrd",
    "report mien.mcap", "report mien.parquet", "report mien.csv", "report tune-mien.json",
    "repair mien.mcap", "export mien.mcap --out a.csv", "listen mien.mcap",
    "law replay mien.mcap --law off", "run --repeat mien.mcap", "run --set controller.law=mien.py",
    "run --set plate.modes=mien.csv", "run --set materials=mien.toml",
    "run --set controller.latency_trace=mien.csv", "budget --trace mien.csv",
    "budget --uncertain mien.toml", "budget --check mien.toml",
    "sweep --uncertain mien.toml --cases 4", "fit aluminium-3mm mien.csv --free sphere.radius_m",
    "run mien",
)  # fmt: skip


@pytest.mark.parametrize("words", READ)
def test_a_missing_file_has_a_near_name_and_a_remedy(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for ending in ("toml", "py", "csv", "parquet", "mcap"):
        Path(f"mine.{ending}").touch()
    Path("tune-mine.json").touch()
    says = refused("", *words.split())
    assert "Did you mean" in says
    assert "mine" in says.partition("Did you mean")[2]
    assert says.endswith(".")
    assert "Errno" not in says


def test_a_folder_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "none" / "a.csv"
    why = why_unreadable(path, FileNotFoundError(), "Give a file.")
    assert why == f"the folder {path.parent} does not exist. Give a file."


def test_a_file_of_another_kind_is_not_meant(tmp_path):
    (tmp_path / "mine.txt").touch()
    assert close_name(tmp_path / "mien.csv") is None
