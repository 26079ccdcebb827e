"""Laws, scenes and hits that people bring, each with its right answer (field/laws/README.md)."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fitting.records.field import FOLDER
from tests.hertzloop.commands import hertzloop

LAWS = FOLDER / "laws"
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not LAWS.is_dir(), reason="the files are not beside the clone"),
]
PEAKS_N = {0.2: 92.0, 0.5: 98.6}  # by the gain


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(LAWS, tmp_path / "laws")
    return tmp_path / "laws"


def ran(folder: Path, *words: str) -> str:
    return hertzloop(*words, cwd=folder, env=os.environ | {"COLUMNS": "200"}).stdout


def python(folder: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True)


def peak_n(folder: Path, *words: str) -> float:
    """Largest contact force of a run."""
    ran(folder, "run", *words, "--out", "one.mcap", "--json", "one.json", "--overwrite")
    return float(json.loads((folder / "one.json").read_text())["impacts"][0]["peak_force_n"])


@pytest.mark.parametrize("law", ["filegain.py", "sub.py"])
def test_a_gain_from_elsewhere_is_that_of_now(law, folder):
    file, text = {
        "filegain.py": ("gain.txt", "{}"),
        "sub.py": ("lib/gains.py", "K = {}"),
    }[law]
    scene = ("base.toml", "--set", f"controller.law={law}")
    swept = ("sweep", *scene, "--over", "controller.latency_us=0,1", "--out", "s.csv")
    program = (
        "import hertzloop, pathlib\n"
        f"scene = ('base.toml', {{'controller.law': {law!r}}})\n"
        "for gain in (0.2, 0.5):\n"
        f"    pathlib.Path({file!r}).write_text({text!r}.format(gain))\n"
        "    print(hertzloop.simulate(hertzloop.load(*scene)).impacts[0].peak_force_n)\n"
    )
    for transport in ("zenoh", "inprocess", "compiled"):
        for gain, expected in PEAKS_N.items():
            (folder / file).write_text(text.format(gain))
            assert peak_n(folder, *scene, "--transport", transport) == pytest.approx(
                expected, abs=0.1
            )
    found = []
    for gain in PEAKS_N:
        (folder / file).write_text(text.format(gain))
        ran(folder, *swept, *(("--overwrite",) if found else ()))
        with (folder / "s.csv").open(newline="") as lines:
            found.append(float(next(csv.DictReader(lines))["peak_force_n"]))
    assert found == pytest.approx(list(PEAKS_N.values()), abs=0.1)
    ran(folder, "run", *scene, "--out", "half.mcap")
    (folder / file).write_text(text.format(0.2))
    replayed = hertzloop("law", "replay", "half.mcap", "--law", law, cwd=folder, code=1)
    assert "the forces differ first at step" in replayed.stdout + replayed.stderr
    done = python(folder, "-c", program)
    assert [float(x) for x in done.stdout.split()] == pytest.approx(list(PEAKS_N.values()), abs=0.1)


def test_a_law_that_keeps_its_state_at_module_level_is_refused(folder):
    done = hertzloop("run", "base.toml", "--set", "controller.law=stateg.py", cwd=folder, code=2)
    assert "not deterministic" in done.stderr
    assert "not deterministic" in python(folder, "two_runs.py").stderr


def test_a_sample_says_its_time(folder):
    gap, force = python(folder, "daq_time.py").stdout.splitlines()
    assert gap.startswith("True")
    assert "at the time of the sample" in gap
    assert force.startswith("True")
    assert "mean of the step before" in force


def test_the_age_of_the_force_under_jitter_is_printed(folder):
    said = python(folder, "jitter_age.py").stdout.splitlines()
    ages = [float(re.search(r"mean ([\d.]+)", line).group(1)) - 1.0 for line in said]
    keys = [
        (),
        ("controller.jitter_us=20",),
        ("controller.latency_trace=[0, 20]",),
        (f"controller.latency_trace={[0.0] * 9 + [20.0]}",),
    ]
    for age, words in zip(ages, keys, strict=True):
        sets = [
            x
            for word in ("controller.law=age.py", "run.duration_s=0.02", *words)
            for x in ("--set", word)
        ]
        out = ran(folder, "run", "base.toml", *sets, "--details", "--out", f"{age}.mcap")
        found = re.search(r"mean latency\W+([\d.]+) us", out)
        assert (found is not None) == (age > 0.0)
        assert not found or float(found.group(1)) == pytest.approx(age, abs=0.1)


def test_a_restitution_on_a_rigid_support(folder):
    done = python(folder, "hunt_crossley_bounces.py")
    assert done.returncode == 0, done.stderr
    first, later = done.stdout.splitlines()
    ratios = [float(x) for x in re.findall(r"\([\d.]+, ([\d.]+),", first)]
    assert ratios[0] == pytest.approx(0.8, abs=0.005)
    assert ratios[1] > ratios[0]
    assert later.startswith("32 mm: [(")


@pytest.mark.parametrize(
    ("words", "expected"),
    [(("bom_scene.toml",), 88.1), (("base.toml", "--set", "controller.law=lat.py"), 92.0)],
)
def test_files_in_other_encodings_run(words, expected, folder):
    assert peak_n(folder, *words) == pytest.approx(expected, abs=0.1)
