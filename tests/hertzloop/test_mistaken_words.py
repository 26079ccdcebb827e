"""What a user types by mistake is answered with what is wrong and what to do, and exit code 2."""

import json
import shlex
from pathlib import Path

import pytest

from hertzloop.cli.commands import GROUPS, all_commands
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from tests.hertzloop.own_laws import write_law
from tests.hertzloop.test_cli import SHORT, call, here, said

__all__ = ["here"]  # the fixture


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            "run --set controller.law=pdc.c",
            "controller.law = 'pdc.c': is source code. Run `cc -O2 "
            "-fPIC -shared -ffp-contract=off pdc.c -o pdc.so -lm`, then set controller.law = "
            "'pdc.so'",
        ),
        (
            "run --set controller.law=mine",
            "controller.law = 'mine': unknown law, but the file mine.py exists. Give the "
            "full file name, controller.law = 'mine.py'",
        ),
        ("sweep --over controller.law=off,mine", "unknown law, but the file mine.py exists"),
        ("tune --law mine", "unknown law, but the file mine.py exists"),
        (
            "run a.mcap",
            "a.mcap: is a recording, not a scene. To show it, run `hertzloop "
            "inspect a.mcap`. To repeat it, run `hertzloop run --repeat a.mcap`.",
        ),
        ("scene check a.mcap", "a.mcap: is a recording, not a scene."),
        (
            "run --set plate.edges=ccc",
            "plate.edges = 'ccc': must be four letters, for the edges at x = 0, x = l_x, y = 0 and "
            "y = l_y. Give c (clamped), s (simply supported) or f (free) for each, as in 'cccc'",
        ),
        (
            "run --set sensors.bits=12.5",
            "sensors.bits = 12.5: must be a whole number or 'ideal'. Give a value from 1 to 24",
        ),
        (
            "run --set controller.bits=many",
            "controller.bits = 'many': must be a whole number or 'ideal'. Give a value from 2 to",
        ),
        ("run --set run.accuracy=nan", "run.accuracy = nan: must be a finite number. Give a value"),
        (
            "run --set contact.damping=oil",
            "contact.damping = 'oil': must be 'none', 'viscous', 'hunt_crossley' or 'relaxation'",
        ),
        ("run --set plate.material=3", "plate.material = 3: must be text or a table"),
        ("run --out a.txt", "--out = a.txt: a recording must end in .mcap"),
        *(
            (f"{command} --name {name}", f"--name = '{name}': must be 1 to 100 letters, digits")
            for command, name in (
                ("run", "**"),
                ("run", ""),
                ("node plant", "?"),
                ("node recorder", "#"),
                ("node watch", "$*"),
                ("law test", "a/b"),
            )
        ),
        ("node recorder --out a", "--out = a: a recording must end in .mcap"),
        ("repair a.mcap --out a.bin", "--out = a.bin: a recording must end in .mcap"),
        ("tune -o tuned.csv", "tuned.csv: must be a folder, not a file. Give a name without .csv"),
        (
            "run --set controller.latency_us=1500 --set run.duration_s=0.0015",
            "controller.latency_us = 1500: is as long as the run, so no force acts. "
            "Reduce it or increase run.duration_s (now 0.0015)",
        ),
    ],
)
def test_it_is_answered(words: str, sentence: str, here: Path) -> None:
    write_law(here)
    (here / "pdc.c").write_text("")
    before = sorted(here.iterdir())
    result = call(*words.split(" "))
    assert result.exit_code == 2
    assert sentence in said(result)
    assert sorted(here.iterdir()) == before


def test_a_file_of_a_law_beside_its_scene_is_named(here: Path) -> None:
    folder = here / "scenes"
    folder.mkdir()
    write_law(folder)
    call("scene", "new", "scenes/a.toml")
    text = (folder / "a.toml").read_text().replace('"slope_threshold"', '"mine"')
    (folder / "a.toml").write_text(text)
    with pytest.raises(
        SceneError, match=r"law = 'mine': unknown law, but the file mine\.py exists"
    ):
        load("scenes/a.toml")


def test_latency_up_to_the_end_is_accepted_and_off_needs_no_force() -> None:
    scene = load("aluminium-3mm", ["run.duration_s=0.0015"])
    assert scene.vary({"controller.latency_us": 1498}).latency_us == 1498.0
    assert scene.vary({"controller.latency_us": 1e6, "controller.law": "off"}).steps == 1500


def test_h_is_help_for_every_command() -> None:
    paths = [entry.words.split() for entry in all_commands()]
    for path in [[], *([group.name] for group in GROUPS), *paths]:
        full, short = call(*path, "--help"), call(*path, "-h")
        assert (short.exit_code, short.output) == (0, full.output), path


def test_json_on_standard_output_is_alone_there(here: Path) -> None:
    tune = ["aluminium-3mm", "--law", "predicted", "--set", "controller.lead_us=1",
            "--set", "run.accuracy=0.05", "--set", "run.duration_s=0.0016", "--generations", "1",
            "--population", "4", "--minimise", "plate_energy_db"]  # fmt: skip
    for words, key in (
        (["run", "aluminium-3mm", *SHORT], "impacts"),
        (["inspect", "aluminium-3mm.mcap"], "problems"),
        (
            ["law", "replay", "aluminium-3mm.mcap", "--law", "off", "-o", "a.png"],
            "first_difference",
        ),
        (["sweep", *SHORT[2:], "--over", "controller.kappa=0.4,0.8", "-o", "a.csv"], "cases_per_s"),
        (["sweep", "--verify", "a.csv", "--cases", "1", "--transport", "compiled"], "differing"),
        (["scene", "check", *SHORT[2:]], "scene"),
        (["tune", *tune, "-o", "tuned"], "front"),
    ):
        result = call(*words, "--json", "-")
        assert result.exit_code == 0, result.stderr
        assert key in json.loads(result.stdout)
        assert result.stderr
    assert not (here / "-").exists()
    assert "Complete" in call("inspect", "aluminium-3mm.mcap").stdout  # the next command as ever

    # The search before: it names the command and has written the scene of its best setting.
    printed = call("tune", *tune, "-o", "tuned").stdout.splitlines()
    [line] = [line.strip() for line in printed if line.startswith("  hertzloop run ")]
    words = shlex.split(line)[2:]
    settings = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    again = load(words[0], settings)
    assert load("tuned/tuned-aluminium-3mm.toml") == again
    front = json.loads((here / "tuned" / "tune-aluminium-3mm.json").read_text())["tuned"]["front"]
    assert again.scene.controller.keys.kappa in [one["values"]["controller.kappa"] for one in front]
