"""What a user types by mistake is answered with what is wrong and what to do, and exit code 2."""

import os
import shlex
from pathlib import Path

import pytest

from hertzloop.cli.commands import GROUPS, all_commands
from hertzloop.common.missing_files import close_name, why_unreadable
from hertzloop.scene.loading import shipped_text
from tests.commands import call, refused
from tests.hertzloop.cli.test_cli import SHORT
from tests.tiers import default

NO_MCAP = ": is not an MCAP recording of hertzloop"
LAW = "def command(p, s, samples, i):\n    return 0.0\n"
FILES = {
    "a.png": b"\x89PNG\r\n\x1a\n0000", "a.json": b'{"a": 1}', "a.csv": b"a,b\n1,2\n",
    "a.partial": b'{"a": 1}\n', "mine.py": LAW.encode(), "pdc.c": b"",
    "ports.json5": b'{listen: {endpoints: {peer: ["tcp/[::1]:99999#iface=lo"]}}}',
}  # fmt: skip


# A command, and words of its answer.
ANSWERS = {
    "run no-such-scene": "SCENE = 'no-such-scene': unknown scene",
    "run a.csv": "the scene a.csv is not valid TOML",
    "run a.mcap": "To show it, run `hertzloop inspect a.mcap`. To repeat it, run `hertzloop",
    "run mine.py": "mine.py: is a law, not a scene. Use --set controller.law=mine.py",
    "run --set controller.law=pdc.c": "'pdc.c': is source code. Run `cc -O2 -fPIC -shared",
    "run --set controller.law=mine": "but the file mine.py exists. Give the full file name",
    "run --set controller.latency_us=1500 --set run.duration_s=0.0015":
    "controller.latency_us = 1500: is as long as the run, so no force acts.",
    "run --out a.txt": "--out = a.txt: a recording must end in .mcap",
    "run --out no/such/folder/a.mcap": "the folder no/such/folder does not exist",
    "run --out pipe.mcap": "not a regular file. Choose another name",
    "run --out link.mcap": "/none/x, which does not exist. Remove the link",
    "export a.mcap --out pipe.csv": "not a regular file",
    "sweep --over sensors.bits=8 --out pipe.csv": "not a regular file",
    "scene modes aluminium-3mm --out pipe.csv": "not a regular file",
    f"run --out {'a' * 300}.mcap": "File name too long. Choose another name",
    "run --json no/such/folder/a.json": "the folder no/such/folder does not exist",
    "margin --json folder.json": "folder.json: is a folder",
    "run --name **": "--name = '**': must be 1 to 100 letters, digits",
    """run --controller "sh 'x" """: "No closing quotation. Close the quotation.",
    "run --controller 'sh {connect}'": "has one of {listen} and {connect}. Use both, or none",
    "law test --controller no-such-program": "no-such-program': cannot be started",
    "law test --controller true --law none": "controller.law = 'none': unknown law",
    "law test --law off": "--controller: missing. Give the command line of your program.",
    "run --repeat a.csv": f"a.csv{NO_MCAP}",
    "inspect a.png": f"a.png{NO_MCAP}",
    "inspect .": "cannot read .: Is a directory",
    "inspect pdc.c": f"pdc.c{NO_MCAP}",
    "law replay a.json --law off": f"a.json{NO_MCAP}",
    "law replay a.mcap --law off --set controller.law=predicted": "--law names the law. Remove one",
    "law replay a.mcap --law off --set sensors.bits=4":
    "--set sensors.bits = 4: has no effect on recorded samples. Set keys of [controller] only",
    "repair a.csv": f"nothing to repair: a.csv{NO_MCAP}",
    "replay a.mcap --screenshot a.jpg": "--screenshot = a.jpg: must end in .png",
    "tune -o tuned.csv": "tuned.csv: must be a folder, not a file. Give a name without .csv",
    "sweep --verify a.csv": "No such option: --verify",
    "sweep --over sensors.bits=8 --picture a.txt": "a.txt: unknown picture format",
    "report a.csv -o r": f"a.csv{NO_MCAP}",
    "sweep --over sensors.bits=8 --cases 5": "--cases = 5: has no effect on a grid",
    "budget --check a.csv --goal x": "--goal = x: has no effect with --check",
    "budget --check a.csv --no-real-plant": "--no-real-plant: has no effect with --check",
    "run --seed 3 --set run.seed=4": "run.seed = 4: another option sets it to 3. Remove one",
    "run --set sensors.bits=4 --set sensors.bits=8": "bits = 8: another option sets it to 4",
    "margin --law off --set controller.law=predicted": "another option sets it to 'off'",
    "run --transport compiled --max-exchange-steps 3": "max_exchange_steps = 3: not available",
    "run --transport inprocess --no-shared-memory": "--no-shared-memory: has no effect with --tr",
    "run --transport compiled --realtime on": "--realtime = on: has no effect with --transport",
    "run --transport compiled --port 7450": "--port = 7450: has no effect with --transport",
    "run --set sensors.resonance_damping=0.1": "has no effect without sensors.resonance_hz. Leave",
    "run --set controller.latency_trace_use=replay": "effect without controller.latency_trace",
    "run --set controller.latency_trace=[]": "controller.latency_trace = []: is empty. Give",
    "sweep --over run.seed=1,2 --seed 3": "--seed = 3: the sweep varies run.seed. Remove one",
    "sweep --over sensors.bits=8,9 --phases 3 --set run.touch_phase=0.3":
    "--set run.touch_phase=0.3: the sweep varies this key. Remove one of the two",
    "budget --within 0.1": "--within = 0.1: has no effect without --uncertain. Remove it",
    "export-plant aluminium-3mm -o p.fmu --out-dir pp":
    "--out = p.fmu: cannot be combined with --out-dir. Remove one of the two",
    "sweep --over run.touch_phase=0.1,0.2 --phases 4":
    "--phases 4 spreads run.touch_phase, so --over cannot give it too",
    "run --set sensors.full_scale=1e-4": '"contact", "none", -1e9 to 1e9.',
    "sweep --over plate.size_m=0.1,0.2": "Possible values: 2 numbers, 0.01 to 20 m",
    "scene modes aluminium-3mm -o modes.txt": "modes.txt",
    "node watch --save a.txt": "--save = a.txt: must end in .rrd",
    "node controller --listen nonsense": "'nonsense': invalid endpoint. Write it as tcp/",
    "node watch --connect tcp/127.0.0.1": "--connect = 'tcp/127.0.0.1': invalid endpoint",
    "node controller --zenoh-config a.png": "--zenoh-config: a.png: is not a zenoh",
    "node recorder --zenoh-config ports.json5": "'tcp/[::1]:99999#iface=lo' has no",
    "node plant --listen tcp/1.2.3.4:99999": "'tcp/1.2.3.4:99999' has no port up to 65535",
}  # fmt: skip
# They need a package of `.[all-tests]`.
DASK = {
}  # fmt: skip


@pytest.mark.parametrize("words", default(ANSWERS | DASK, ANSWERS))
def test_it_is_answered(words, here):
    (here / "folder.json").mkdir()
    (here / "link.mcap").symlink_to(here / "none" / "x")
    for name in ("pipe.mcap", "pipe.csv"):
        os.mkfifo(here / name)
    for name, content in FILES.items():
        (here / name).write_bytes(content)
    before = set(here.iterdir())
    assert "damaged" not in refused((ANSWERS | DASK)[words], *shlex.split(words))
    assert set(here.iterdir()) == before


def test_h_is_help_for_every_command():
    paths = [entry.words.split() for entry in all_commands()]
    for path in [[], *([group.name] for group in GROUPS), *paths]:
        full, short = call(*path, "--help"), call(*path, "-h")
        assert (short.exit_code, short.output) == (0, full.output), path


def test_a_name_that_means_two_things_is_refused(here):
    """A scene that is shipped and a file, and a law beside the scene and in the working folder."""
    text = shipped_text("aluminium-3mm")
    (here / "aluminium-3mm").write_text(text)
    refused("Write ./aluminium-3mm for the file, or rename the file", "run", "aluminium-3mm")
    (here / "scenes").mkdir()
    (here / "scenes" / "a.toml").write_text(text)
    for folder in (here, here / "scenes"):
        (folder / "amb.py").write_text(LAW)
    words = ["scene", "check", "scenes/a.toml", "--set", "controller.law=amb.py"]
    said = refused(f"{here / 'scenes' / 'amb.py'}, beside the scene, and {here / 'amb.py'}", *words)
    assert "Give the whole path of one of them" in said
    (here / "amb.py").unlink()
    assert call(*words).exit_code == 0


INPUTS = {
    "run --repeat a.mcap --out": "./a.mcap",
    "repair a.mcap --out": "linked.mcap",
    "export a.mcap --out": "./a.mcap",
    "run mine.toml --out": "mine.toml",
    "run --set controller.law=mine.py --out": "mine.py",
    "sweep --set plate.modes=m.csv --over sensors.bits=4,5 -o": "m.csv",
}


def test_an_input_is_not_replaced(here):
    """A recording by any of its names, and all that a scene is made of."""
    (here / "mine.py").write_text(LAW)
    call("scene", "modes", "aluminium-3mm", "-o", "m.csv")
    shipped = shipped_text("aluminium-3mm").replace('law = "slope_threshold"', 'law = "mine.py"')
    (here / "mine.toml").write_text(shipped)
    call("run", "aluminium-3mm", *SHORT, "--out", "a.mcap")
    (here / "linked.mcap").hardlink_to(here / "a.mcap")
    before = {path: path.read_bytes() for path in here.iterdir()}
    for words, name in INPUTS.items():
        sentence = f"{Path(name)}: is an input of this command"
        refused(sentence, *words.split(), name, "--overwrite")
    assert {path: path.read_bytes() for path in here.iterdir()} == before


READ = (
    "run mien.toml", "sweep mien.toml --over sensors.bits=8", "tune mien.toml", "margin mien.toml",
    "budget mien.toml", "scene check mien.toml", "export-plant mien.toml --out a.fmu",
    "inspect mien.mcap", "compare mien.mcap mine.mcap", "replay mien.mcap --save a.rrd",
    "report mien.mcap", "report mien.parquet", "report mien.csv", "report tune-mien.json",
    "repair mien.mcap", "export mien.mcap --out a.csv", "listen mien.mcap",
    "law replay mien.mcap --law off", "run --repeat mien.mcap", "run --set controller.law=mien.py",
    "run --set plate.modes=mien.csv", "run --set materials=mien.toml",
    "run --set controller.latency_trace=mien.csv", "budget --trace mien.csv",
    "budget --uncertain mien.toml", "budget --check mien.toml",
    "sweep --uncertain mien.toml --cases 4", "fit aluminium-3mm mien.csv --free sphere.radius_m",
    "run mien",
)  # fmt: skip


@pytest.mark.parametrize("words", READ)
def test_a_missing_file_has_a_near_name_and_a_remedy(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for ending in ("toml", "py", "csv", "parquet", "mcap"):
        Path(f"mine.{ending}").touch()
    Path("tune-mine.json").touch()
    says = refused("", *words.split())
    assert "Did you mean" in says
    assert "mine" in says.partition("Did you mean")[2]
    assert says.endswith(".")
    assert "Errno" not in says


def test_a_folder_that_is_not_there_is_named(tmp_path):
    path = tmp_path / "none" / "a.csv"
    why = why_unreadable(path, FileNotFoundError(), "Give a file.")
    assert why == f"the folder {path.parent} does not exist. Give a file."


def test_a_file_of_another_kind_is_not_meant(tmp_path):
    (tmp_path / "mine.txt").touch()
    assert close_name(tmp_path / "mien.csv") is None
