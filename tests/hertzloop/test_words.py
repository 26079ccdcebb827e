"""What is printed: text from files, scenes and other processes is shown as it is."""

import shutil
from pathlib import Path

import pytest

from tests.hertzloop.test_cli import call, here, said

__all__ = ["here"]  # the fixture
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["a[/y].mcap", "[red]b.mcap"])
def test_markup_in_a_file_name_means_nothing(name: str, here: Path) -> None:
    for file in (name, f"new{name}"):
        (here / file).parent.mkdir(exist_ok=True)
    shutil.copy(next((ROOT / "recordings" / "golden").glob("*.mcap")), name)
    for words in (["inspect", name], ["compare", name, name]):
        assert call(*words).exit_code == 0
    assert name in call("inspect", name).output
    Path(name).write_bytes(Path(name).read_bytes()[:-4000])
    assert name in said(call("compare", name, name))
    done = call("repair", name, "--out", f"new{name}")
    assert done.exit_code == 0
    assert f"new{name}" in done.output


@pytest.mark.parametrize("value", ["[/y]", "[red]x"])
def test_markup_in_a_refused_value(value: str) -> None:
    done = call("run", "--set", f"plate.material={value}")
    assert done.exit_code == 2
    assert value in said(done)
