"""Files of another kind than a command works on, and files that it would read and write at once."""

import shutil
from pathlib import Path

import pytest

from hertzloop.scene.loading import shipped_text
from tests.hertzloop.own_laws import EXAMPLES, build
from tests.hertzloop.test_cli import SHORT, call, here, said

__all__ = ["here"]  # the fixture

NO_MCAP = ": is not an MCAP recording of hertzloop"
LAW = "def command(p, s, samples, i):\n    return 0.0\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("inspect a.png", f"a.png{NO_MCAP}"),
        ("report a.png -o r", f"a.png{NO_MCAP}"),
        ("law replay a.json --law off", f"a.json{NO_MCAP}"),
        ("run --repeat a.csv", f"a.csv{NO_MCAP}"),
        ("repair a.csv", f"nothing to recover: a.csv{NO_MCAP}"),
        (
            "report a.partial -o r",
            "a.partial: is unfinished. Run the command that started it again",
        ),
        ("report none.parquet -o r", "none.parquet: no such results"),
        ("report tune-none.json -o r", "tune-none.json: no such results"),
        ("sweep --verify none.csv", "none.csv: no such results"),
        (
            "sweep --verify a.csv",
            "a.csv: the file a.csv.json is missing beside it",
        ),
        (
            "sweep --verify a.json",
            "a.json holds no results of a sweep, which end in .parquet or .csv",
        ),
        ("run a.csv", "the scene a.csv is not valid TOML"),
        ("run mine.py", "mine.py: is a law, not a scene. Use --set controller.law=mine.py"),
        ("node watch --save a.txt", "--save = a.txt: must end in .rrd"),
        ("replay a.mcap --save a.mcap", "--save = a.mcap: must end in .rrd"),
        ("replay a.mcap --screenshot a.jpg", "--screenshot = a.jpg: must end in .png"),
        (
            "law replay a.mcap --law off -o a.mcap",
            "a.mcap: unknown picture format. Use a name that ends in .png",
        ),
        (
            "sweep --over run.touch_phase=0.1,0.2 --phases 4",
            "--phases 4 spreads run.touch_phase, so --over cannot give it too",
        ),
        (
            "sweep --over plate.size_m=0.1,0.2",
            "must be a list in brackets, such as [0.1, 0.2]",
        ),
        ("sweep mine.py --over sensors.bits=4,5", "mine.py: is a law, not a scene"),
    ],
)
def test_it_is_named(words: str, sentence: str, here: Path) -> None:
    (here / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n0000")
    (here / "a.json").write_text('{"a": 1}')
    (here / "a.csv").write_text("a,b\n1,2\n")
    (here / "a.partial").write_text('{"a": 1}\n')
    (here / "mine.py").write_text(LAW)
    result = call(*words.split())
    assert result.exit_code == 2
    assert sentence in said(result)
    assert "damaged" not in said(result)


@pytest.mark.parametrize("name", ["a.mcap", "./a.mcap", "linked.mcap"])
def test_what_is_read_is_not_replaced(name: str, here: Path) -> None:
    call("run", "aluminium-3mm", *SHORT, "--out", "a.mcap")
    (here / "linked.mcap").hardlink_to(here / "a.mcap")
    before = (here / "a.mcap").read_bytes()
    for words in (
        ["run", "--repeat", "a.mcap", "--out", name],
        ["repair", "a.mcap", "--out", name],
        ["export", "a.mcap", "--out", name],
    ):
        result = call(*words, "--overwrite")
        assert result.exit_code == 2
        assert f"{Path(name)}: is an input of this command" in said(result)
    assert (here / "a.mcap").read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ["run", "mine.toml", "--out", "mine.toml"],
        ["run", "--set", "controller.law=mine.py", "--out", "mine.py"],
        ["run", "mine.toml", "--out", "./mine.py"],
        ["sweep", "--set", "plate.modes=m.csv", "--over", "sensors.bits=4,5", "-o", "m.csv"],
        ["scene", "modes", "--set", "plate.modes=m.csv", "-o", "m.csv"],
    ],
)
def test_what_a_scene_is_made_of_is_not_replaced(words: list[str], here: Path) -> None:
    (here / "mine.py").write_text(LAW)
    call("scene", "modes", "aluminium-3mm", "-o", "m.csv")
    shipped = shipped_text("aluminium-3mm").replace('law = "slope_threshold"', 'law = "mine.py"')
    assert "mine.py" in shipped
    (here / "mine.toml").write_text(shipped)
    before = {path: path.read_bytes() for path in here.iterdir()}
    result = call(*words, "--overwrite")
    assert result.exit_code == 2
    assert f"{Path(words[-1])}: is an input of this command" in said(result)
    assert {path: path.read_bytes() for path in here.iterdir()} == before


@pytest.mark.skipif(not shutil.which("cc"), reason="needs a C compiler")
def test_a_law_in_c_is_not_replaced_by_a_plant(here: Path) -> None:
    library = build(here, EXAMPLES / "low_passed.c")
    before = library.read_bytes()
    words = [
        "export-plant",
        "aluminium-3mm",
        "--set",
        f"controller.law={library.name}",
        "-o",
        library.name,
    ]
    result = call(*words, "--overwrite")
    assert result.exit_code == 2
    assert f"{library.name}: is an input of this command" in said(result)
    assert library.read_bytes() == before


LONG = 300 * "x"  # no file has such a name


@pytest.mark.parametrize(
    "words",
    [
        f"run {LONG}",
        f"run {LONG}.toml",
        f"run --set controller.law={LONG}.py",
        f"run --set plate.modes={LONG}.csv",
        f"run --repeat {LONG}.mcap",
        f"inspect {LONG}.mcap",
        f"report {LONG}.parquet -o r",
        f"report {LONG} -o r",
        f"report a.mcap -o {LONG}",
        f"sweep --verify {LONG}.parquet",
        f"law replay {LONG}.mcap --law off",
        f"export-plant aluminium-3mm --out-dir {LONG}",
        f"node keys {LONG} --hosts plant=a,controller=b,recorder=c",
        f"sweep --over sensors.bits=4,5 -o {LONG}.csv",
        f"tune -o {LONG}",
        f"law new {LONG}.py",
    ],
)
def test_a_name_too_long_for_a_file(words: str, here: Path) -> None:
    result = call(*words.split())  # which lets no other exception pass
    assert result.exit_code == 2
    assert "error: " in said(result)
