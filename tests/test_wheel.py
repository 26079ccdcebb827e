"""The wheel installs one package, `hertzloop`, and a user's own modules stay the user's."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OWN = ("controller.py", "plant.py", "jit.py", "law.py", "bus/__init__.py", "recordings/__init__.py")
RUN = ["--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1"]


def built(root: Path, target: str, folder: Path) -> Path:
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", folder],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    [path] = folder.iterdir()
    return path


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The wheel of the clone, and the wheel of its source distribution."""
    folder = tmp_path_factory.mktemp("built")
    source = built(ROOT, "sdist", folder / "source")
    with tarfile.open(source) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    [unpacked] = (folder / "unpacked").iterdir()
    return built(ROOT, "wheel", folder / "wheel"), built(unpacked, "wheel", folder / "again")


@pytest.mark.full
def test_the_wheel_holds_one_package(wheels: tuple[Path, Path]) -> None:
    names = [set(zipfile.ZipFile(wheel).namelist()) for wheel in wheels]
    assert names[0] == names[1]
    tops = {name.split("/")[0] for name in names[0]}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"hertzloop"}
    for needed in ("plant/plant.py", "controller/loading/start/hertzloop_law.h", "law.py",
                   "bus/hertzloop_lane.h", "scenes/aluminium-3mm.toml"):  # fmt: skip
        assert f"hertzloop/{needed}" in names[0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the user's own modules, which have the names of our folders."""
    for name in OWN:
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"OWNER = 'the user, in {name}'\n")
    (tmp_path / "mine.py").write_text(
        "from controller import OWNER\nfrom hertzloop.law import Keys\nassert 'user' in OWNER\n"
        "senses = 'v_p'\n\n\nclass Parameters(Keys):\n    pass\n\n\n"
        "def command(p, s, samples, i):\n    return -0.1 * samples[i]\n"
    )
    (tmp_path / "script.py").write_text(
        "import controller, plant, bus, jit, recordings, hertzloop\n"
        "print(hertzloop.load('aluminium-3mm').name)\n"
        "print(controller.OWNER, plant.OWNER, bus.OWNER, jit.OWNER, recordings.OWNER)\n"
    )
    return tmp_path


def called(folder: Path, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=200,
        check=False, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, (words, done.stdout[-500:], done.stderr[-1500:])
    return done.stdout


def test_a_law_and_a_script_import_the_modules_of_the_user(folder: Path) -> None:
    law = ["--set", "controller.law=mine.py", "--out", "a.mcap"]
    called(folder, "-m", "hertzloop", "run", "aluminium-3mm", "--transport", "compiled", *RUN, *law)
    assert called(folder, "script.py").count("the user") == 5


@pytest.mark.full
def test_commands_work_beside_modules_of_these_names(folder: Path) -> None:
    here = ("-m", "hertzloop")
    called(folder, *here, "run", "aluminium-3mm", *RUN, "--set", "controller.law=mine.py",
           "--out", "b.mcap")  # fmt: skip
    called(folder, *here, "replay", "b.mcap", "--save", "b.rrd")
    called(folder, *here, "inspect", "b.mcap")
    called(folder, *here, "sweep", "aluminium-3mm", *RUN, "--over", "controller.latency_us=0,1",
           "--set", "controller.law=mine.py", "--out", "s.csv")  # fmt: skip
    called(folder, *here, "law", "new", "fresh.py")
    called(folder, *here, "scene", "list")
