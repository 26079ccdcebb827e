"""Commands in surroundings that lack something: streams, folders, /proc, open files."""

import errno
import os
import shlex
import subprocess
from pathlib import Path

import pytest

from hertzloop.__main__ import lacks_explained
from hertzloop.cli.commands import leaves
from hertzloop.recordings.reader import read
from tests.hertzloop.processes import HERTZLOOP
from tests.hertzloop.short_runs import SHORT

SCENE = ["aluminium-3mm", *(word for setting in SHORT for word in ("--set", setting))]
NODE = f"{shlex.join(HERTZLOOP)} node controller --name {{name}} --listen {{listen}} " \
       "--connect {connect}"  # fmt: skip
# A cheap call of each command, and its exit code where nothing lacks. {a}: a recording, {out}: a
# folder for results, {docs}: the examples of the documentation.
COMMANDS = {
    "run": (["run", *SCENE, "--out", "{out}/a.mcap"], 0),
    "replay": (["replay", "{a}", "--save", "{out}/a.rrd"], 0),
    "sweep": (["sweep", *SCENE, "--over", "controller.latency_us=0,1", "--workers", "2",
               "--out", "{out}/a.csv"], 0),
    "tune": (["tune", *SCENE, "--generations", "1", "--population", "4", "--out-dir", "{out}/t"],
             0),
    "margin": (["margin", "aluminium-20mm", "--set", "controller.law=velocity_feedback", "--set",
                "controller.kappa=0.05"], 0),
    "fit": (["fit", "{docs}/bench.toml", "{docs}/bench-force.csv", "--free", "sphere.radius_m",
             "--out", "{out}/a.toml"], 1),
    "report": (["report", "{a}", "--out-dir", "{out}/pages"], 0),
    "inspect": (["inspect", "{a}"], 0),
    "compare": (["compare", "{a}", "{a}"], 0),
    "repair": (["repair", "{a}", "--out", "{out}/b.mcap"], 0),
    "export": (["export", "{a}", "--out", "{out}/a.csv"], 0),
    "listen": (["listen", "{a}", "--out-dir", "{out}/sounds", "--tail", "0"], 0),
    "scene list": (["scene", "list"], 0),
    "scene show": (["scene", "show", "aluminium-3mm"], 0),
    "scene new": (["scene", "new", "{out}/a.toml"], 0),
    "scene keys": (["scene", "keys", "latency"], 0),
    "scene check": (["scene", "check", "aluminium-3mm"], 0),
    "scene modes": (["scene", "modes", "aluminium-3mm", "--out", "{out}/a.csv"], 0),
    "law list": (["law", "list"], 0),
    "law new": (["law", "new", "{out}/a.py"], 0),
    "law replay": (["law", "replay", "{a}", "--law", "shifted_threshold", "--out", "{out}/a.png"],
                   0),
    "law test": (["law", "test", "--controller", NODE, "--script", "touch", "--timeout", "60",
                  "--wait", "120"], 0),
    "node plant": (["node", "plant", *SCENE, "--wait", "0.1", "--name", "nobody"], 1),
    "node keys": (["node", "keys", "{out}/keys", "--hosts", "plant=10.0.0.1,controller=10.0.0.2,"
                   "recorder=10.0.0.3"], 0),
    "export-plant": (["export-plant", "aluminium-3mm", "--out", "{out}/a.so"], 0),
    "bench": (["bench", *SCENE, "--quick"], 0),
}  # fmt: skip
# They wait for others, as `node plant` does, or take half a minute.
OTHERS = {"budget", "node controller", "node recorder", "node watch"}
SILENT = {"node plant"}  # on standard output

CLOSED = {"no input": "<&-", "no output": ">&-", "no errors": "2>&-", "nothing": "<&- >&- 2>&-"}
DOCS = Path(__file__).parents[2] / "docs" / "examples"
NO_PROC = ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs tmpfs /proc && exec "$@"')
FULL_OUTPUT = "error: cannot write standard output: No space left on device"


def run_in(
    before: tuple[str, ...], words: list[str], out: Path, recording: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command behind `before`, which gets the folder of results as its first argument."""
    places = {"{a}": str(recording), "{out}": str(out), "{docs}": str(DOCS)}
    for name, place in places.items():
        words = [word.replace(name, place) for word in words]
    done = subprocess.run(
        [*before, str(out), *HERTZLOOP, *words], capture_output=True, text=True, cwd=out,
        stdin=subprocess.DEVNULL, timeout=600, check=False,
    )  # fmt: skip
    said = done.stderr + done.stdout
    assert not any(word in said for word in ("Traceback", "Exception ignored", "panicked")), said
    assert len(done.stderr.splitlines()) <= 8, done.stderr
    return done


def with_streams(redirected: str) -> tuple[str, ...]:
    return ("sh", "-c", f'exec "$@" {redirected}')


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recorded")
    words = ["run", *SCENE, "--transport", "compiled", "--out", "{out}/a.mcap"]
    assert run_in(with_streams(""), words, out).returncode == 0
    return out / "a.mcap"


def works(before: tuple[str, ...]) -> bool:
    """Whether these surroundings can be made here."""
    words = [*before, "/dev/shm", "true"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0


def test_every_command_is_tried_or_left_out_for_a_reason() -> None:
    assert COMMANDS.keys() | OTHERS == {leaf.words for leaf in leaves()}


@pytest.mark.parametrize("words", [["--version"], ["law", "--help"]])
@pytest.mark.parametrize("redirected", [*CLOSED.values(), ">/dev/full 2>&1"])
def test_streams_that_are_closed_or_full(words: list[str], redirected: str, tmp_path: Path) -> None:
    done = run_in(with_streams(redirected), words, tmp_path)
    assert done.returncode == ("full" in redirected)
    assert not done.stderr


@pytest.mark.parametrize("words", [["--version"], ["scene", "show", "oak-20mm"], ["law", "-h"]])
def test_results_that_find_no_room(words: list[str], tmp_path: Path) -> None:
    done = run_in(with_streams(">/dev/full"), words, tmp_path)
    assert (done.returncode, done.stderr.strip()) == (1, FULL_OUTPUT)


@pytest.mark.parametrize(
    ("before", "said"),
    [
        (("sh", "-c", 'mkdir gone; cd gone; rmdir "$PWD"; exec "$@"'),
         "error: the working folder no longer exists. Change to another folder."),
        (("sh", "-c", 'ulimit -n 20; exec "$@"'),
         "error: only 20 files may be open at once. Raise the limit of open files: "
         "ulimit -n 1024."),
    ],
)  # fmt: skip
def test_what_all_commands_need(before: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = run_in(before, ["--version"], tmp_path)
    assert (done.returncode, done.stderr.strip()) == (1, said)


def test_a_limit_of_open_files_that_may_be_raised_is_raised(tmp_path: Path) -> None:
    assert (
        run_in(("sh", "-c", 'ulimit -S -n 20; exec "$@"'), ["--version"], tmp_path).returncode == 0
    )


def ended(error: Exception, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit, match="1"), lacks_explained():
        raise error
    return capsys.readouterr().err


def test_what_is_said_of_errors_of_the_system(capsys: pytest.CaptureFixture[str]) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "a\x1b.csv")
    said = "error: a\\x1b.csv: No space left on device. Free some space.\n"
    assert ended(full, capsys) == said
    many = ImportError("libm.so: cannot open shared object file: Too many open files")
    assert ended(many, capsys).startswith("error: Too many open files. Raise the limit")
    assert ended(OSError("no\nnumber"), capsys) == "error: no number\n"
    with pytest.raises(ValueError, match="ours"), lacks_explained():
        raise ValueError("ours")


@pytest.mark.full
@pytest.mark.parametrize("transport", ["zenoh", "compiled"])
@pytest.mark.parametrize("redirected", CLOSED.values(), ids=CLOSED)
def test_a_run_without_streams_is_recorded(redirected: str, transport: str, tmp_path: Path) -> None:
    words = ["run", *SCENE, "--transport", transport, "--out", "{out}/a.mcap"]
    assert run_in(with_streams(redirected), words, tmp_path).returncode == 0
    found = read(tmp_path / "a.mcap")
    assert not found.problems
    assert found.truth.samples == 2500


@pytest.mark.full
@pytest.mark.parametrize("command", COMMANDS)
class TestEveryCommand:
    """Every command, in each of the surroundings."""

    @pytest.fixture(autouse=True)
    def here(self, command: str, tmp_path: Path, recording: Path) -> None:
        self.out, self.recording = tmp_path, recording
        self.words, self.code = COMMANDS[command]

    def run(self, before: tuple[str, ...]) -> tuple[int, str]:
        done = run_in(before, self.words, self.out, self.recording)
        return done.returncode, done.stderr

    def test_closed_streams(self, command: str) -> None:
        assert self.run(with_streams("<&- >&- 2>&-")) == (self.code, "")

    def test_full_output(self, command: str) -> None:
        code, said = self.run(with_streams(">/dev/full"))
        assert code == 1
        assert command in SILENT or said.strip().endswith(FULL_OUTPUT)

    def test_no_proc(self, command: str) -> None:
        if not works(NO_PROC):
            pytest.skip("no mount namespace of one's own here")
        code, said = self.run(NO_PROC)
        assert code == self.code, said
