"""The command line as a user meets it: files, exit codes, sentences."""

import math

import pytest

from hertzloop.cli.node import check_endpoints
from hertzloop.recordings.reader import read
from tests.commands import as_options, call, refused, said, succeed
from tests.hertzloop.commands import hertzloop
from tests.hertzloop.scenes import json_in

SHORT = ["--transport", "compiled", "--set", "run.duration_s=0.0015"]


def test_first_run_of_a_new_user(here):
    """Real processes, no argument but a shorter run: recording, closing table, all metrics."""
    done = hertzloop("run", "--set", "run.duration_s=0.02", "--json", "a.json", cwd=here)
    lines = done.stdout.splitlines()
    assert lines[:2] == [
        "Control reduces plate energy by 6.3 to 6.4 dB in the first impact.",
        "Over all contacts the change is -5.2 to -5.1 dB, with 1 contact instead of 7.",
    ]
    assert lines[-1] == "Next: hertzloop replay aluminium-20mm.mcap"
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    for words in ("with control", "without", "change", "Recording: ", "--details"):
        assert words in done.stdout
    for words in ("residual", "seed", "zenoh", "Longhorn", "eq. 3.12"):  # --details has them
        assert words not in done.stdout
    noise = "acceleration noise, Longhorn"
    assert noise not in succeed("inspect", "aluminium-20mm.mcap")
    assert noise in succeed("inspect", "aluminium-20mm.mcap", "--details")
    recording = read(here / "aluminium-20mm.mcap")
    assert not recording.problems
    assert recording.truth.samples == recording.force.samples == recording.daq.samples == 20_000
    data = json_in(here / "a.json")
    expected = {
        "scene": "aluminium-20mm",
        "law": "slope_threshold",
        "seed": 1,
        "steps": 20_000,
        "scene_law": "slope_threshold",
        "transport": "zenoh",
    }
    assert expected.items() <= data.items()
    assert data["real_time_factor"] == pytest.approx(0.02 / data["wall_s"])
    assert data["exchanges"] > 0
    assert max(map(abs, data["residuals"].values())) < 1e-10
    assert len(data["impacts"]) == 1
    assert len(data["uncontrolled"]["impacts"]) == 7
    assert (
        {*data["impacts"][0]}
        == {*data["uncontrolled"]["impacts"][0]}
        == {
            "start_s",
            "duration_s",
            "impact_speed_m_s",
            "rebound_speed_m_s",
            "peak_force_n",
            "plate_energy_j",
            "plate_speed_max_m_s",
        }
    )
    assert "--overwrite" in refused("aluminium-20mm.mcap exists", "run")


def test_a_run_on_an_infinite_plate(here):
    run = [
        "run",
        "aluminium-3mm",
        "--details",
        "--transport",
        "compiled",
        "--overwrite",
        "--set",
        "controller.law=off",
    ]
    told = succeed(*run, "--set", "run.duration_s=0.00114", "--verify", "--json", "a.json")
    assert "infinite plate, a dashpot of 308.2 N s/m" in told
    assert "Error of the missing reflections " in told
    assert "missed" not in told
    data = json_in(here / "a.json")
    assert data["plate_model"] == "infinite"
    assert data["frequencies"] == 0
    assert data["expected_error"] <= data["requested_accuracy"]
    assert data["verification"]["largest"] <= data["requested_accuracy"]
    # Asked for where reflections matter, it is taken, and the run says what that costs.
    asked = as_options(["run.plate_model=infinite", "run.duration_s=0.0012"])
    assert "(requested 0.001; missed)" in succeed(*run, *asked)


def test_nothing_is_overwritten_unasked(here):
    (here / "aluminium-3mm.mcap").write_text("mine")
    refused("aluminium-3mm.mcap exists", "run", "aluminium-3mm", *SHORT)
    refused("aluminium-3mm.mcap exists", "node", "recorder", "--out", "aluminium-3mm.mcap")
    assert (here / "aluminium-3mm.mcap").read_text() == "mine"
    succeed("run", "aluminium-3mm", *SHORT, "--overwrite")
    assert read(here / "aluminium-3mm.mcap").truth.samples == 1500


def test_the_scene_of_a_recording_runs_again(here):
    seen = ["--seed", "5", "--set", "sensors.bits=12", "--json", "a.json"]
    succeed("run", "oak-20mm", *SHORT, *seen, "--out", "a.mcap")
    recording = read(here / "a.mcap")
    assert json_in(here / "a.json")["seed"] == 5
    assert len(recording.daq.arrays["code"])
    (here / "mine.toml").write_text(recording.scene_toml)
    succeed("run", "mine.toml", "--transport", "inprocess", "--out", "b.mcap")
    told = succeed("compare", "a.mcap", "b.mcap")
    assert "the same: 1,500 steps of truth, 1,500 samples, 1,500 forces" in told
    succeed("run", "mine.toml", *SHORT, "--set", "controller.latency_us=1", "--out", "c.mcap")
    different = call("compare", "a.mcap", "c.mcap")
    assert different.exit_code == 1
    assert "differs first at step" in said(different)


def test_compare_shows_metrics_of_two_laws(here):
    run = [
        "run",
        "--transport",
        "compiled",
        *as_options(["run.duration_s=0.0016", "run.accuracy=0.05"]),
    ]
    for name, law in (("a", "slope_threshold"), ("b", "force_feedback")):
        law_of = as_options([f"controller.law={law}", "controller.kappa=0.4"])
        succeed(*run, *law_of, "--out", f"{name}.mcap", "--json", f"{name}.json")
    told = succeed("compare", "a.mcap", "b.mcap", "--metrics", "--json", "c.json")
    assert "force_feedback" in told
    a, b, c = (json_in(here / f"{name}.json") for name in "abc")
    rows = {(row["span"], row["metric"]): row for row in c["metrics"]}
    for (span, metric), row in rows.items():
        values = row["reference"]["value"], row["value"]["value"]
        assert values == (a[span][metric], b[span][metric])
    energy = rows["first_impact", "plate_energy_j"]
    assert energy["unit"] == "dB"
    ratio = energy["value"]["value"] / energy["reference"]["value"]
    assert energy["change"]["value"] == pytest.approx(10.0 * math.log10(ratio))
    for wrong in (["--json", "d.json"], ["--metrics", "--tolerance", "1e-9"]):
        refused("error: ", "compare", "a.mcap", "b.mcap", *wrong)


def test_scenes_are_listed():
    listed = succeed("scene", "list")
    for name in ("aluminium-20mm (default)", "aluminium-3mm", "oak-20mm", "sylomer-20mm"):
        assert name in listed


def test_endpoints_that_zenoh_takes_are_taken():
    plain = ["tcp/[::1]:7450", "ws/localhost:7450", "unixsock-stream//tmp/a.b"]
    with_words = ["udp/10.0.0.1:7450?rel=1", "tls/lab.example:65535#iface=eth0"]
    check_endpoints("--listen", plain + with_words)


@pytest.mark.parametrize(
    "words",
    [
        "run --out F.mcap",
        "inspect none.mcap --json F.json",
        "node recorder --out F.mcap",
        "replay none.mcap --save F.rrd",
        "sweep --over sensors.bits=4,5 --out F.csv",
        "tune --out-dir F",
    ],
)
def test_what_cannot_be_written_is_said_before_work_starts(here, monkeypatch, words):
    """In /proc not even root can make a file."""

    def work(*_: object) -> None:
        raise AssertionError("work has started")

    monkeypatch.setattr("hertzloop.warmup.ensure_compiled", work)
    folder = words.endswith(" F")  # that would have to be made
    sentence = "cannot create the folder" if folder else "cannot write to the folder /proc"
    refused(sentence, *words.replace("F", "/proc/no").split())
