"""The command line as a user meets it: files, exit codes, sentences."""

import json
import math
import sys
from pathlib import Path

import pytest
from typer.testing import Result

from hertzloop.cli.node import check_endpoints
from hertzloop.recordings.reader import read
from tests.commands import invoke
from tests.hertzloop.processes import hertzloop

SHORT = ["--transport", "compiled", "--set", "run.duration_s=0.0015"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*words: str) -> Result:
    """Run a command in this process, on a wide terminal."""
    result = invoke(list(words), env={"COLUMNS": "200"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


def said(result: Result) -> str:
    """What was printed, without line breaks and frames."""
    return " ".join(result.output.replace("│", " ").split())


def test_first_run_of_a_new_user(here: Path) -> None:
    """Real processes, no argument but a shorter run: recording, closing table, all metrics."""
    done = hertzloop("run", "--set", "run.duration_s=0.02", "--json", "a.json", cwd=here)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "Control reduces plate energy by 6.0 dB in the first impact."
    assert lines[1] == "Over all contacts the change is -7.1 dB, with 2 contacts instead of 6."
    assert lines[-1] == "Next: hertzloop replay aluminium-20mm.mcap"
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith("│") for line in lines) <= 10
    for words in ("with control", "without", "change", "residual", "Recording: ", "--details"):
        assert words in done.stdout
    inspected = call("inspect", "aluminium-20mm.mcap").output
    assert len(inspected.splitlines()) <= 40
    for all_of_it in (call("inspect", "aluminium-20mm.mcap", "--details").output,):
        assert "Impacts" in all_of_it
        assert "acceleration noise, Longhorn" in all_of_it
        assert "acceleration noise, Longhorn" not in inspected
    recording = read(here / "aluminium-20mm.mcap")
    assert not recording.problems
    assert recording.truth.samples == recording.force.samples == recording.daq.samples == 20_000
    data = json.loads((here / "a.json").read_text())
    assert data["scene"] == "aluminium-20mm"
    assert (data["law"], data["scene_law"]) == ("slope_threshold", "slope_threshold")
    assert (data["seed"], data["transport"], data["steps"]) == (1, "zenoh", 20_000)
    assert data["wall_s"] > 0
    assert data["real_time_factor"] == pytest.approx(0.02 / data["wall_s"])
    assert data["exchanges"] > 0
    assert abs(data["residuals"]["momentum"]) < 1e-10
    assert abs(data["residuals"]["energy"]) < 1e-10
    keys = {
        "start_s", "duration_s", "impact_speed_m_s", "rebound_speed_m_s", "peak_force_n",
        "plate_energy_j", "plate_speed_max_m_s",
    }  # fmt: skip
    assert len(data["impacts"]) == 2
    assert len(data["uncontrolled"]["impacts"]) == 6
    for impact in data["impacts"] + data["uncontrolled"]["impacts"]:
        assert set(impact) == keys
    again = hertzloop("run", cwd=here)
    assert again.returncode == 2
    assert "aluminium-20mm.mcap exists" in again.stderr
    assert "--overwrite" in again.stderr


@pytest.mark.full
def test_the_table_says_what_was_chosen_and_what_the_full_model_would_have_cost(
    here: Path,
) -> None:
    done = call("run", "aluminium-3mm", *SHORT, "--json", "a.json", "--details")
    for words in (
        "564 frequencies up to 244.7 kHz", "1,104 frequencies up to 500 kHz", "1.96 times as many",
        "times as long (measured)", "sufficient until 1.154 ms, beyond the first contact",
    ):  # fmt: skip
        assert words in said(done), words
    model = json.loads((here / "a.json").read_text())["model"]
    assert model["plate_model"] == "modal"
    assert model["infinite_until_s"] == pytest.approx(1.154e-3, abs=1e-6)
    assert model["full"]["frequencies"] == 1104
    assert model["full"]["frequency_limit_hz"] == pytest.approx(5e5)
    assert model["full"]["frequency_ratio"] == 1104 / 564
    assert model["full"]["measured_ratio"] > 0.0

    few = call(
        "run", "sylomer-20mm", *SHORT, "--set", "run.accuracy=0.05", "--json", "s.json", "--details"
    )
    assert "a ratio of frequencies, not of measured time" in said(few)
    assert "sufficient until" not in said(few)
    assert json.loads((here / "s.json").read_text())["model"]["full"]["measured_ratio"] is None

    old = call("run", "thesis-oak", *SHORT, "--json", "t.json", "--details")
    assert "full model" not in said(old)
    assert json.loads((here / "t.json").read_text())["model"] is None


def test_a_run_on_an_infinite_plate(here: Path) -> None:
    settings = ["--details", "--transport", "compiled", "--set", "controller.law=off", "--set"]
    done = call(
        "run", "aluminium-3mm", *settings, "run.duration_s=0.00114", "--verify", "--json", "a.json"
    )
    assert "infinite plate, a dashpot of 308.2 N s/m; missing reflections may cost" in said(done)
    assert "missed" not in said(done)
    data = json.loads((here / "a.json").read_text())
    assert data["model"]["plate_model"] == "infinite"
    assert (data["frequencies"], data["model"]["full"]["frequency_ratio"]) == (0, None)
    assert data["expected_error"] <= data["requested_accuracy"]
    assert data["verification"]["largest"] <= data["requested_accuracy"]
    # Asked for where reflections matter, it is taken, and the table says what that costs.
    late = [*settings, "run.duration_s=0.0012", "--set", "run.plate_model=infinite"]
    assert "(requested: 0.001; missed)" in said(
        call("run", "aluminium-3mm", *late, "--out", "b.mcap")
    )
    later = [*settings, "run.duration_s=0.01", "--set", "run.plate_model=infinite"]
    assert "by the run's end is not known" in said(
        call("run", "aluminium-3mm", *later, "--out", "c.mcap")
    )


def test_nothing_is_overwritten_unasked(here: Path) -> None:
    (here / "aluminium-3mm.mcap").write_text("mine")
    refused = call("run", "aluminium-3mm", *SHORT)
    assert refused.exit_code == 2
    assert (here / "aluminium-3mm.mcap").read_text() == "mine"
    assert call("node", "recorder", "--out", "aluminium-3mm.mcap").exit_code == 2
    assert call("run", "aluminium-3mm", *SHORT, "--overwrite").exit_code == 0
    assert read(here / "aluminium-3mm.mcap").truth.samples == 1500


def test_seed_and_settings_reach_the_recording(here: Path) -> None:
    call("run", "oak-20mm", *SHORT, "--seed", "5", "--set", "sensors.bits=12", "--out", "o.mcap",
         "--json", "o.json")  # fmt: skip
    recording = read(here / "o.mcap")
    assert "bits = 12" in recording.scene_toml
    assert json.loads((here / "o.json").read_text())["seed"] == 5
    assert len(recording.daq.arrays["code"])


def test_scene_from_a_file(here: Path) -> None:
    recorded = call("run", "aluminium-3mm", *SHORT)
    assert recorded.exit_code == 0
    (here / "mine.toml").write_text(read(here / "aluminium-3mm.mcap").scene_toml)
    assert call("run", "mine.toml", "--transport", "inprocess", "--out", "b.mcap").exit_code == 0
    same = call("compare", "aluminium-3mm.mcap", "b.mcap")
    assert same.exit_code == 0
    assert "the same: 1,500 steps of truth, 1,500 samples, 1,500 forces" in said(same)


def test_compare_shows_metrics_of_two_laws(here: Path) -> None:
    run = ("run", "--set", "run.duration_s=0.0016", "--set", "run.accuracy=0.05", "--transport",
           "compiled", "--overwrite")  # fmt: skip
    for name, law in (("a", "slope_threshold"), ("b", "force_feedback")):
        law_of = ("--set", f"controller.law={law}", "--set", "controller.kappa=0.4")
        done = call(*run, *law_of, "--out", f"{name}.mcap", "--json", f"{name}.json")
        assert done.exit_code == 0, done.output
    done = call("compare", "a.mcap", "b.mcap", "--metrics", "--json", "c.json")
    assert done.exit_code == 0, done.output
    assert "force_feedback" in done.output
    assert "plate energy" in done.output
    a, b, c = (json.loads((here / f"{name}.json").read_text()) for name in "abc")
    rows = {(row["span"], row["metric"]): row for row in c["metrics"]}
    for (span, metric), row in rows.items():
        assert (row["a"], row["b"]) == (a[span][metric], b[span][metric])
    energy = rows["first_impact", "plate_energy_j"]
    assert energy["b_to_a"] == 10.0 * math.log10(energy["b"] / energy["a"])
    assert energy["unit"] == "dB"
    speed = rows["whole_run", "rebound_speed_m_s"]
    assert speed["b_to_a"] == 100.0 * (speed["b"] / speed["a"] - 1.0)
    for wrong in (["--json", "d.json"], ["--metrics", "--tolerance", "1e-9"]):
        assert call("compare", "a.mcap", "b.mcap", *wrong).exit_code == 2


def test_compare_tells_the_first_difference(here: Path) -> None:
    call("run", "aluminium-3mm", *SHORT, "--out", "a.mcap")
    call("run", "aluminium-3mm", *SHORT, "--out", "b.mcap", "--set", "controller.latency_us=1")
    different = call("compare", "a.mcap", "b.mcap")
    assert different.exit_code == 1
    assert "differs first at step" in said(different)
    assert call("compare", "a.mcap", "none.mcap").exit_code == 2


def test_inspect_whole_and_cut_off(here: Path) -> None:
    call(
        "run",
        "aluminium-3mm",
        "--transport",
        "compiled",
        "--set",
        "run.duration_s=0.3",
        "--out",
        "a.mcap",
    )
    whole = call("inspect", "a.mcap", "--json", "a.json")
    assert whole.exit_code == 0
    data = json.loads((here / "a.json").read_text())
    assert data["streams"]["truth"]["samples"] == 300_000
    assert not data["problems"]
    content = (here / "a.mcap").read_bytes()
    (here / "cut.mcap").write_bytes(content[: len(content) // 2])
    cut = call("inspect", "cut.mcap", "--json", "cut.json")
    assert cut.exit_code == 1
    data = json.loads((here / "cut.json").read_text())
    assert 0 < data["streams"]["truth"]["samples"] < 300_000
    assert data["problems"]
    assert "cut off" in said(cut)


def test_scenes_are_listed() -> None:
    listed = call("scene", "list")
    assert listed.exit_code == 0
    for name in ("aluminium-20mm (default)", "aluminium-3mm", "oak-20mm", "sylomer-20mm"):
        assert name in listed.output


SWEEP = ["sweep", "--over", "sensors.bits=8,9", "--dask"]
PLANT, CONTROLLER, RECORDER, WATCH = (
    ["node", name] for name in ("plant", "controller", "recorder", "watch")
)
BOTH_ENDS = ["--listen", "tcp/127.0.0.1:7460", "--connect", "tcp/127.0.0.1:7461"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["run", "no-such-scene"], "SCENE = 'no-such-scene': unknown scene"),
        (["run", "--set", "controller.latency_us=0.5"], "controller.latency_us = 0.5"),
        (["run", "--transport", "pigeon"], "'pigeon' is not one of"),
        (["run", "--out", "no/such/folder/a.mcap"], "the folder no/such/folder does not exist"),
        (["run", "--out", "."], "not a regular file"),
        (["run", "--json", "no/such/folder/a.json"], "the folder no/such/folder does not exist"),
        (["run", "--out", "a" * 300], "File name too long"),
        (["run", "--json", "a" * 300], "File name too long"),
        (["export-plant", "aluminium-3mm", "--out-dir", "a" * 300], "File name too long"),
        (["bench", "--nonsense"], "No such option"),
        (
            ["law", "replay", "none.mcap", "--law", "off", "-o", "a"],
            "a: unknown picture format. Use a name that ends in .png",
        ),
        (["run", "--horizon", "0"], "Invalid value for '--horizon'"),
        (["run", "--seed", "x"], "Invalid value for '--seed'"),
        (["inspect", "none.mcap"], "none.mcap"),
        (["inspect", "text.mcap"], "text.mcap"),
        (["inspect", "empty.mcap"], "empty.mcap"),
        (["compare", "none.mcap", "none.mcap"], "none.mcap"),
        ([*PLANT, "--zenoh-config", "none.json5"], "does not exist"),
        ([*PLANT, "--set", "run.seed=-1"], "run.seed = -1"),
        (
            [*CONTROLLER, "--listen", "nonsense"],
            "'nonsense': invalid endpoint. Write it as tcp/",
        ),
        (
            [*CONTROLLER, "--connect", "tcp/127.0.0.1"],
            "--connect = 'tcp/127.0.0.1': invalid endpoint",
        ),
        (
            [*CONTROLLER, "--zenoh-config", "text.mcap"],
            "--zenoh-config: text.mcap: is not a zenoh",
        ),
        ([*PLANT, "--zenoh-config", "text.mcap", *BOTH_ENDS], "text.mcap: is not a zenoh"),
        (
            [*RECORDER, "--zenoh-config", "ports.json5"],
            "ports.json5: 'tcp/[::1]:99999#iface=lo' has no",
        ),
        (["run", "--timeout", "1e300"], "Invalid value for '--timeout'"),
        ([*PLANT, "--wait", "nan"], "Invalid value for '--wait'"),
        (
            [*PLANT, "--listen", "tcp/1.2.3.4:99999"],
            "'tcp/1.2.3.4:99999' has no port up to 65535",
        ),
        (
            [*RECORDER, "--connect", "wire/x:1"],
            "--connect = 'wire/x:1': invalid endpoint. Write it as",
        ),
        (
            [*WATCH, "--connect", "nonsense"],
            "--connect = 'nonsense': invalid endpoint. Write it as",
        ),
        ([*WATCH, "--connect", "tcp/[::1]:99999"], "has no port up to 65535"),
        pytest.param(
            [*SWEEP, "nonsense"],
            "--dask = 'nonsense': invalid scheduler address. Give it as tcp://",
            marks=pytest.mark.full,
        ),
        pytest.param(
            [*SWEEP, ""], "--dask = '': invalid scheduler address", marks=pytest.mark.full
        ),
        pytest.param(
            [*SWEEP, "wire://127.0.0.1:80"],
            "--dask = 'wire://127.0.0.1:80': invalid scheduler address",
            marks=pytest.mark.full,
        ),
        pytest.param(
            [*SWEEP, "tcp://[::1]:99999"],
            "--dask = 'tcp://[::1]:99999': invalid port. Give a port from 1 to 65535",
            marks=pytest.mark.full,
        ),
    ],
)
def test_the_users_mistakes(here: Path, words: list[str], sentence: str) -> None:
    (here / "text.mcap").write_text("this is no recording")
    (here / "empty.mcap").touch()
    (here / "ports.json5").write_text('{listen: {endpoints: {peer: ["tcp/[::1]:99999#iface=lo"]}}}')
    before = set(here.iterdir())
    result = call(*words)
    assert set(here.iterdir()) == before
    assert result.exit_code == 2, result.output
    assert sentence in said(result)
    assert "Traceback" not in result.output


def test_endpoints_that_zenoh_takes_are_taken() -> None:
    plain = ["tcp/[::1]:7450", "ws/localhost:7450", "unixsock-stream//tmp/a.b"]
    with_words = ["udp/10.0.0.1:7450?rel=1", "tls/lab.example:65535#iface=eth0"]
    check_endpoints("--listen", plain + with_words)


WRITERS = [
    "run --out F.mcap", "run --json F.json", "node recorder --out F.mcap",
    "inspect none.mcap --json F.json", "replay none.mcap --save F.rrd",
    "replay none.mcap --screenshot F.png",
    "repair none.mcap --out F.mcap", "sweep --over sensors.bits=4,5 --out F.csv",
    "sweep --over sensors.bits=4,5 --json F.json", "sweep --verify none.csv --json F.json",
    "tune --out-dir F", "tune --json F.json", "bench --json F.json",
]  # fmt: skip


@pytest.mark.parametrize("words", WRITERS)
def test_what_cannot_be_written_is_said_before_work_starts(
    here: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    """In /proc not even root can make a file."""

    def work(*_: object) -> None:
        raise AssertionError("work has started")

    monkeypatch.setattr("hertzloop.warmup.ensure_compiled", work)
    result = call(*words.replace("F", "/proc/no").split())
    assert result.exit_code == 2
    folder = words.endswith(" F")  # that would have to be made
    sentence = "cannot create the folder" if folder else "cannot write to the folder /proc"
    assert sentence in said(result)


def test_a_folder_is_not_written_as_a_file(here: Path) -> None:
    (here / "folder.json").mkdir()
    result = call("bench", "--json", "folder.json")
    assert result.exit_code == 2
    assert "folder.json: is a folder" in said(result)


@pytest.mark.full
def test_rerun_is_imported_only_where_it_is_used(here: Path) -> None:
    script = (
        "import sys; from tests.commands import invoke;"
        f"assert invoke({['run', 'aluminium-3mm', *SHORT]!r}).exit_code == 0;"
        "assert 'rerun' not in sys.modules and 'matplotlib' not in sys.modules"
    )
    import subprocess

    subprocess.run([sys.executable, "-c", script], check=True, cwd=here)


@pytest.mark.full
def test_a_compiled_run_imports_neither_network_nor_published_plant(here: Path) -> None:
    import subprocess

    words = ["run", "aluminium-3mm", *SHORT, "--transport", "compiled"]
    script = (
        "import sys; from tests.commands import invoke;"
        f"assert invoke({words!r}).exit_code == 0;"
        "print([name for name in sys.modules if name in ('zenoh', 'hertzloop.bus.liveliness',"
        " 'hertzloop.plant.schemes.thesis2008') or name.startswith('hertzloop.studies.margin')])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=here)
    assert done.stdout.splitlines()[-1:] == ["[]"], done.stdout + done.stderr
