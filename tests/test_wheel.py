"""The wheel installs one package, `hertzloop`, and a user's own modules stay the user's."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.hertzloop.commands import python

ROOT = Path(__file__).parents[1]
OWN = ("controller.py", "plant.py", "jit.py", "law.py", "bus/__init__.py", "recordings/__init__.py")
RUN = ["--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.1"]


def built(root: Path, target: str, folder: Path) -> Path:
    python("-m", "hatchling", "build", "-t", target, "-d", folder, cwd=root)
    [path] = folder.iterdir()
    return path


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """The wheel of the clone, and the wheel of its source distribution."""
    folder = tmp_path_factory.mktemp("built")
    source = built(ROOT, "sdist", folder / "source")
    with tarfile.open(source) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    [unpacked] = (folder / "unpacked").iterdir()
    return built(ROOT, "wheel", folder / "wheel"), built(unpacked, "wheel", folder / "again")


@pytest.mark.full
def test_the_wheel_holds_one_package(wheels):
    names = [set(zipfile.ZipFile(wheel).namelist()) for wheel in wheels]
    assert names[0] == names[1]
    tops = {name.split("/")[0] for name in names[0]}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"hertzloop"}
    for needed in (
        "plant/plant.py",
        "controller/loading/start/hertzloop_law.h",
        "law.py",
        "bus/hertzloop_ring.h",
        "bus/messages.proto",
        "scene/aluminium-3mm.toml",
    ):
        assert f"hertzloop/{needed}" in names[0]


@pytest.fixture
def folder(tmp_path):
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


@pytest.mark.full
def test_a_law_and_a_script_import_the_modules_of_the_user(folder):
    place = {"cwd": folder, "env": {**os.environ, "PYTHONPATH": str(ROOT)}}
    law = ["--set", "controller.law=mine.py", "--out", "a.mcap", "--transport", "compiled"]
    python("-m", "hertzloop", "run", "aluminium-3mm", *RUN, *law, **place)
    assert python("script.py", **place).stdout.count("the user") == 5


@pytest.fixture(scope="module")
def installed(wheels, tmp_path_factory):
    """Python of an environment that holds the wheel and its dependencies: links to our
    site-packages bring these, and leave the editable install out."""
    environment = tmp_path_factory.mktemp("installed") / "env"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    found = environment / "bin" / "python"
    subprocess.run([found, "-m", "pip", "install", "-q", "--no-deps", wheels[0]], check=True)
    [packages] = environment.glob("lib/python*/site-packages")
    ours = [path for path in sys.path if path.endswith("site-packages")]  # environments may nest
    (packages / "dependencies.pth").write_text("\n".join(ours) + "\n")
    return str(found)


@pytest.mark.full
def test_the_installed_wheel_brings_one_package(installed, tmp_path):
    """Its commands: see test_page_commands.py."""

    def run(*words: str) -> str:
        done = subprocess.run(
            [installed, *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": ""},
        )
        assert done.returncode == 0, (words, done.stderr)
        return done.stdout

    found = run("-c", "import hertzloop; print(hertzloop.__file__)")
    assert found.startswith(str(Path(installed).parents[1]))
    for name in ("plant", "controller", "sensors", "bus", "recordings", "common", "tests"):
        run("-c", f"import importlib.util as u; assert u.find_spec({name!r}) is None, {name!r}")
