"""What is printed: text from files, scenes and other processes is shown as it is."""

import shutil
from pathlib import Path

import pytest

from tests.hertzloop.processes import hertzloop

GOLDEN = Path(__file__).parents[2] / "recordings" / "golden"


@pytest.mark.full
@pytest.mark.parametrize("name", ["a[/y].mcap", "[red]b.mcap", "[bold]c[/bold].mcap"])
def test_markup_in_a_file_name_means_nothing(name: str, tmp_path: Path) -> None:
    golden = next(GOLDEN.glob("*.mcap"))
    for file in (name, f"new{name}"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
    shutil.copy(golden, tmp_path / name)
    for words in (["inspect", name], ["compare", name, name]):
        done = hertzloop(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert name in hertzloop("inspect", name, cwd=tmp_path).stdout
    cut = (tmp_path / name).read_bytes()[:-4000]
    (tmp_path / name).write_bytes(cut)
    assert name in " ".join(hertzloop("compare", name, name, cwd=tmp_path).stderr.split())
    done = hertzloop("repair", name, "--out", f"new{name}", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"new{name}" in done.stdout


def test_markup_in_a_run(tmp_path: Path) -> None:
    scene = hertzloop("scene", "list")
    assert scene.returncode == 0
    toml = (GOLDEN.parents[1] / "hertzloop" / "scenes" / "aluminium-3mm.toml").read_text()
    shows = 'shows = "[red]not red[/y]"'
    lines = [shows if line.startswith("shows") else line for line in toml.splitlines()]
    (tmp_path / "[").mkdir()
    (tmp_path / "[/y].toml").write_text("\n".join(lines))
    words = ["--transport", "compiled", "--set", "run.duration_s=0.0012", "--out", "[/z].mcap"]
    done = hertzloop("run", "[/y].toml", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "hertzloop replay [/z].mcap" in done.stdout


@pytest.mark.parametrize("value", ["[/y]", "[red]x", "[link=https://a]b[/link]"])
def test_markup_in_a_refused_value(value: str) -> None:
    done = hertzloop("run", "--set", f"plate.material={value}")
    assert done.returncode == 2
    assert value in " ".join(done.stderr.split())
