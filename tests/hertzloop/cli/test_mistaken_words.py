"""What a user types by mistake is answered with what is wrong and what to do, and exit code 2."""

from pathlib import Path

import pytest

from hertzloop.cli.commands import GROUPS, all_commands
from hertzloop.scene.loading import shipped_text
from tests.commands import call, refused, said
from tests.hertzloop.cli.test_cli import SHORT

NO_MCAP = ": is not an MCAP recording of hertzloop"
LAW = "def command(p, s, samples, i):\n    return 0.0\n"
FILES = {
    "a.png": b"\x89PNG\r\n\x1a\n0000", "a.json": b'{"a": 1}', "a.csv": b"a,b\n1,2\n",
    "a.partial": b'{"a": 1}\n', "mine.py": LAW.encode(), "pdc.c": b"",
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("run --set controller.law=pdc.c", "'pdc.c': is source code. Run `cc -O2 -fPIC -shared"),
        (
            "run --set controller.law=mine",
            "but the file mine.py exists. Give the full file name",
        ),
        ("run a.mcap", "To show it, run `hertzloop inspect a.mcap`. To repeat it, run `hertzloop"),
        ("run --set plate.edges=ccc", "plate.edges = 'ccc': must be four letters, for the edges"),
        (
            "run --set sensors.bits=12.5",
            "must be a whole number or 'ideal'. Give a value from",
        ),
        ("run --set contact.damping=oil", "must be 'none', 'viscous', 'hunt_crossley' or 'relax"),
        ("run --out a.txt", "--out = a.txt: a recording must end in .mcap"),
        ("run --name **", "--name = '**': must be 1 to 100 letters, digits"),
        ("tune -o tuned.csv", "tuned.csv: must be a folder, not a file. Give a name without .csv"),
        (
            "run --set controller.latency_us=1500 --set run.duration_s=0.0015",
            "controller.latency_us = 1500: is as long as the run, so no force acts.",
        ),
        ("inspect a.png", f"a.png{NO_MCAP}"),
        ("law replay a.json --law off", f"a.json{NO_MCAP}"),
        ("run --repeat a.csv", f"a.csv{NO_MCAP}"),
        ("repair a.csv", f"nothing to recover: a.csv{NO_MCAP}"),
        ("report a.partial -o r", "is unfinished. Run the command that started it again"),
        ("sweep --verify none.csv", "none.csv: no such results"),
        ("sweep --verify a.csv", "a.csv: the file a.csv.json is missing beside it"),
        (
            "sweep --verify a.json",
            "a.json holds no results of a sweep, which end in .parquet or .csv",
        ),
        ("run a.csv", "the scene a.csv is not valid TOML"),
        ("run mine.py", "mine.py: is a law, not a scene. Use --set controller.law=mine.py"),
        ("node watch --save a.txt", "--save = a.txt: must end in .rrd"),
        ("replay a.mcap --screenshot a.jpg", "--screenshot = a.jpg: must end in .png"),
        (
            "law replay a.mcap --law off -o a.mcap",
            "a.mcap: unknown picture format. Use a name that ends in .png",
        ),
        (
            "sweep --over run.touch_phase=0.1,0.2 --phases 4",
            "--phases 4 spreads run.touch_phase, so --over cannot give it too",
        ),
        ("sweep --over plate.size_m=0.1,0.2", "must be a list in brackets, such as [0.1, 0.2]"),
    ],
)
def test_it_is_answered(words: str, sentence: str, here: Path) -> None:
    for name, content in FILES.items():
        (here / name).write_bytes(content)
    result = call(*words.split())
    assert result.exit_code == 2
    assert sentence in said(result)
    assert "damaged" not in said(result)
    assert sorted(path.name for path in here.iterdir()) == sorted(FILES)


def test_h_is_help_for_every_command() -> None:
    paths = [entry.words.split() for entry in all_commands()]
    for path in [[], *([group.name] for group in GROUPS), *paths]:
        full, short = call(*path, "--help"), call(*path, "-h")
        assert (short.exit_code, short.output) == (0, full.output), path


@pytest.mark.parametrize("name", ["./a.mcap", "linked.mcap"])
def test_what_is_read_is_not_replaced(name: str, here: Path) -> None:
    call("run", "aluminium-3mm", *SHORT, "--out", "a.mcap")
    (here / "linked.mcap").hardlink_to(here / "a.mcap")
    before = (here / "a.mcap").read_bytes()
    for words in (
        ["run", "--repeat", "a.mcap", "--out", name],
        ["repair", "a.mcap", "--out", name],
        ["export", "a.mcap", "--out", name],
    ):
        refused(f"{Path(name)}: is an input of this command", *words, "--overwrite")
    assert (here / "a.mcap").read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ["run", "mine.toml", "--out", "mine.toml"],
        ["run", "--set", "controller.law=mine.py", "--out", "mine.py"],
        ["sweep", "--set", "plate.modes=m.csv", "--over", "sensors.bits=4,5", "-o", "m.csv"],
    ],
)
def test_what_a_scene_is_made_of_is_not_replaced(words: list[str], here: Path) -> None:
    (here / "mine.py").write_text(LAW)
    call("scene", "modes", "aluminium-3mm", "-o", "m.csv")
    shipped = shipped_text("aluminium-3mm").replace('law = "slope_threshold"', 'law = "mine.py"')
    assert "mine.py" in shipped
    (here / "mine.toml").write_text(shipped)
    before = {path: path.read_bytes() for path in here.iterdir()}
    refused(f"{Path(words[-1])}: is an input of this command", *words, "--overwrite")
    assert {path: path.read_bytes() for path in here.iterdir()} == before
