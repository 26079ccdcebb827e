"""What is printed: text from files, scenes and other processes is shown as it is."""

import shutil
from pathlib import Path

from tests.commands import call, refused, said, succeed
from tests.hertzloop.own_laws import ROOT


def test_markup_in_a_file_name_means_nothing(here):
    name = "a[/y].mcap"
    for file in (name, f"new{name}"):
        (here / file).parent.mkdir(exist_ok=True)
    shutil.copy(next((ROOT / "recordings" / "golden").glob("*.mcap")), name)
    for words in (["inspect", name], ["compare", name, name]):
        assert call(*words).exit_code == 0
    assert name in call("inspect", name).output
    Path(name).write_bytes(Path(name).read_bytes()[:-4000])
    assert name in said(call("compare", name, name))
    assert f"new{name}" in succeed("repair", name, "--out", f"new{name}")


def test_markup_in_a_refused_value():
    refused("[/y]", "run", "--set", "plate.material=[/y]")
