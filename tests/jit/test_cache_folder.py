"""Kernels are kept where only this user writes: what lies there is unpickled and run."""

import os
import pickle
from pathlib import Path

import numba
import pytest
from numba import config

from hertzloop.common.jit import shipped
from tests.hertzloop.commands import python
from tests.hertzloop.own_laws import ROOT

# Imports a kernel and says where it is kept.
WHERE = "from hertzloop.controller.kernels import convert_force as k; print(k._cache.cache_path)"


def where(environment: dict[str, str], script: str = WHERE) -> tuple[Path, str]:
    """Folder of the kernels in a process with this environment alone, and what it complains of."""
    environment = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)} | environment
    done = python("-B", "-c", script, env=environment, cwd=ROOT)
    return Path(done.stdout.strip()).parent, done.stderr


def usual(environment: dict[str, str]) -> Path:
    return Path(environment["HOME"]) / ".cache" / "hertzloop"


def gone_with_the_process(folder: Path, said: str, environment: dict[str, str]) -> bool:
    """Whether a folder was a private one, gone with the process, which said so."""
    assert f"kept in {folder.parent}, while this command runs: " in said
    return folder.parent.parent == Path(environment["TMPDIR"]) and not folder.parent.exists()


@pytest.fixture
def at_home(tmp_path):
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir(mode=0o700)
    return {"HOME": str(tmp_path / "home"), "TMPDIR": str(tmp_path / "tmp")}


def test_the_usual_folder_is_this_user_s_alone(at_home):
    folder, said = where(at_home)
    assert folder.parent == usual(at_home)
    assert [path.stat().st_mode & 0o7777 for path in (folder.parent, folder)] == [0o700, 0o700]
    assert where(at_home) == (folder, "")
    assert not said


def test_without_a_home_a_folder_for_this_process(at_home):
    Path(at_home["HOME"]).rmdir()
    Path(at_home["HOME"]).touch()
    assert gone_with_the_process(*where(at_home), at_home)


def plant_open(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o770)


def plant_link(folder: Path) -> None:
    elsewhere = folder.with_name("elsewhere")
    elsewhere.mkdir(mode=0o700)
    folder.symlink_to(elsewhere)


def plant_foreign(folder: Path) -> None:
    if os.getuid():
        pytest.skip("only root can make a folder of another user")
    folder.mkdir(mode=0o700)
    os.chown(folder, 4321, 4321)


PLANTED = [plant_open, plant_link, plant_foreign]


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("plant", PLANTED)
def test_a_planted_folder_is_not_used(at_home, plant, given):
    place = Path(at_home["HOME"]) / "given" if given else usual(at_home)
    place.parent.mkdir(mode=0o700, exist_ok=True)
    plant(place)
    folder, said = where(at_home | ({"NUMBA_CACHE_DIR": str(place)} if given else {}))
    assert f"{place} is not a folder that only this user can write to" in said
    assert not list(place.iterdir())
    assert gone_with_the_process(folder, said, at_home)


CHANGE_CODE = {"NUMBA_OPT": "1", "NUMBA_SLP_VECTORIZE": "1", "NUMBA_BOUNDSCHECK": "1"}


@pytest.mark.full
def test_settings_of_numba_that_change_the_code_have_a_folder_each(tmp_path):
    home = {"HOME": str(tmp_path)}
    plain = where(home)[0]
    folders = [where(home | {name: value})[0] for name, value in CHANGE_CODE.items()]
    assert len({plain, *folders}) == 1 + len(folders)
    assert where(home | {"NUMBA_NUM_THREADS": "1", "NUMBA_FULL_TRACEBACKS": "1"})[0] == plain


ATTACKED = """
import hertzloop
from benchmarks.integrator_kernels import hertz as k
k(1e9, -1e-6)
print(k._cache.cache_path)
"""


class Evil:
    """Runs code when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple:
        return Path.touch, (self.trace,)


@pytest.mark.full
def test_a_planted_pickle_does_not_run(at_home, tmp_path):
    """The attack itself: a cache that anybody could have put there, under the right names."""
    folder, _ = where(at_home, ATTACKED)
    indices = list(folder.rglob("*.nbi"))
    assert indices
    for index in indices:
        index.write_bytes(pickle.dumps(numba.__version__) + pickle.dumps(Evil(tmp_path / "trace")))
    usual(at_home).chmod(0o777)
    _, said = where(at_home, ATTACKED)
    assert not (tmp_path / "trace").exists()
    assert "is not a folder that only this user can write to" in said
    # It would have run from a folder that counts as safe: the attack is one.
    usual(at_home).chmod(0o700)
    with pytest.raises(AssertionError):
        where(at_home, ATTACKED)
    assert (tmp_path / "trace").exists()


def test_shipped_kernels_are_unpacked_where_the_processor_serves(tmp_path, monkeypatch):
    """Packed from one folder and unpacked into another they lie where Numba seeks them."""
    kept = tmp_path / "kept"
    places = dict(shipped._places(kept))
    for name in ("hertzloop.plant.contact", "laws_compiled"):
        places[name].mkdir(parents=True)
        (places[name] / "a.nbc").write_bytes(b"code")
    (kept / ".compiled-all").touch()
    monkeypatch.setattr(shipped, "SHIPPED", tmp_path / "package" / shipped.SHIPPED.name)
    shipped.pack("digest", kept, tmp_path / "package")

    monkeypatch.setattr(config, "CPU_NAME", "haswell")  # asked for by the user
    shipped.unpack("digest", tmp_path)
    assert not (tmp_path / ".compiled-all").exists()
    monkeypatch.setattr(config, "CPU_NAME", shipped.LEVEL)
    monkeypatch.setattr(config, "CPU_FEATURES", "")
    for _ in range(2):
        shipped.unpack("digest", tmp_path)
        found = {name for name, place in shipped._places(tmp_path) if place.is_dir()}
        assert found == {"hertzloop.plant.contact", "laws_compiled"}
    assert (tmp_path / ".compiled-all").exists()
