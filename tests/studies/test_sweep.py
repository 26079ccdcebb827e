"""Sweeps: designs, same bits as processes, kills and resumption, a Dask cluster that loses one."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from hertzloop.cases import figures_of_case
from hertzloop.cli import app
from hertzloop.compiled import simulate
from hertzloop.impact_rows import first_impact
from hertzloop.scene import SceneError, load, vary
from studies import evaluate
from studies import sweep as study
from studies.design import Axis, Design, DesignError, fitted, make_design, parse_axis
from studies.journal import Journal, JournalError
from studies.replay_cases import replay_cases

COARSE = ["run.accuracy=0.05"]
LATENCIES = Axis("controller.latency_us", tuple(range(12)))


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "hertzloop", *words]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("controller.latency_us=0:6:2", (0, 2, 4, 6)),
        ("controller.kappa=0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("sensors.bits=8,ideal", (8, "ideal")),
        ("plate.contact_point_m=[0.1, 0.2],[0.25, 0.25]", ([0.1, 0.2], [0.25, 0.25])),
        ("sensors.bits=12", (12,)),
    ],
)
def test_values_of_an_axis(text: str, values: tuple[Any, ...]) -> None:
    assert parse_axis(text).values == values


@pytest.mark.parametrize(
    ("over", "says"),
    [
        (["controller.latency_us"], "is no range"),
        (["controller.latency_us=5:1:1"], "runs backwards"),
        (["controller.latency_us=0:5:0"], "must be above 0"),
        (["controller.latency_us=a:b"], "no range of numbers"),
        (["controller.latency_us=0:5"], "has no step"),
        (["controller.latency_us=0:inf:1"], "no range of numbers"),
        (["controller.kappa=1,,2"], "has an empty value"),
        (["controller.kappa=0:1:0.1", "controller.kappa=2"], "given twice"),
        (["controller.latncy_us=0:5:1"], "did you mean latency_us"),
        (["sensors.bits=4:30:1"], "sensors.bits = 30"),
        (["controller.latency_us=0:1:0.5", "run.step_ns=1000"], None),
        ([], "at least one --over"),
    ],
)
def test_what_cannot_be_swept_is_refused_before_the_work(over: list[str], says: str | None) -> None:
    if says is None:  # both ends of every axis fit; a case in between does not, and says so itself
        make_design(load("aluminium-3mm"), over, "grid", 0, 1)
        return
    with pytest.raises((DesignError, SceneError), match=says):
        make_design(load("aluminium-3mm"), over, "grid", 0, 1)


@pytest.mark.parametrize("kind", ["lhs", "sobol"])
def test_spread_points_fill_every_axis_and_are_repeatable(kind: Any) -> None:
    axes = (Axis("controller.kappa", (), 0.0, 2.0), Axis("sensors.bits", (4, 8, 12, 16)))
    cases = Design(axes, kind, 64, 3).cases()
    assert cases == Design(axes, kind, 64, 3).cases()
    assert cases != Design(axes, kind, 64, 4).cases()
    kappas = np.sort([case["controller.kappa"] for case in cases])
    assert np.all(np.abs(kappas - np.linspace(0.0, 2.0, 64)) < 0.07)
    assert [sum(c["sensors.bits"] == b for c in cases) for b in (4, 8, 12, 16)] == [16] * 4


def test_spread_points_are_values_that_their_keys_can_have() -> None:
    scene = load("aluminium-3mm", ["run.step_ns=500"])
    over = ["sensors.bits=4:9", "controller.latency_us=1:3", "run.seed=1:4", "controller.kappa=0:2"]
    cases = make_design(scene, over, "lhs", 60, 1).cases()
    for case in cases:
        vary(scene, case)
    found = {key: sorted({case[key] for case in cases}) for key in cases[0]}
    assert found["sensors.bits"] == [4, 5, 6, 7, 8, 9]
    assert found["controller.latency_us"] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert found["run.seed"] == [1, 2, 3, 4]
    assert len(found["controller.kappa"]) == 60


def test_a_tuned_time_is_a_whole_number_of_steps() -> None:
    scene = load("aluminium-3mm", ["run.step_ns=500"])
    axis = fitted(parse_axis("controller.latency_us=1:9"), scene)
    assert [axis.grained(x) for x in (1.0, 2.2, 2.3, 8.9)] == [1.0, 2.0, 2.5, 9.0]


def test_whole_and_other_numbers_of_an_axis_are_one_column_of_numbers(tmp_path: Path) -> None:
    scene, out = load("aluminium-3mm", COARSE), tmp_path / "r.parquet"
    study.sweep(scene, Design((parse_axis("controller.kappa=0,0.5,1"),)), "impact", out, workers=1)
    rows, _ = study.read_results(out)
    assert [row["controller.kappa"] for row in rows] == [0.0, 0.5, 1.0]
    assert pyarrow.parquet.read_schema(out).field("controller.kappa").type == "double"


@pytest.mark.parametrize("model", ["modal", "infinite"])
def test_the_figures_of_a_case_are_those_of_its_run(model: str) -> None:
    settings = ["run.duration_s=0.0016", "controller.latency_us=3", f"run.plate_model={model}"]
    scene = load("aluminium-3mm", settings)
    figures = figures_of_case(scene)
    assert figures.plate_model == model
    mine = first_impact(scene, simulate(scene).rows)
    free_scene = scene.without_control()
    free = first_impact(free_scene, simulate(free_scene).rows)
    assert mine is not None
    assert free is not None
    assert figures.contacts == 1
    assert figures.rebound_m_s == mine.impact.rebound_speed_m_s
    assert 1e-6 * figures.contact_us == pytest.approx(mine.impact.duration_s, rel=1e-12)
    # Cut when nothing acts any more: the work on the plate is the same but for rounding.
    assert figures.plate_energy_j == pytest.approx(mine.impact.plate_energy_j, rel=1e-12)
    change = 10.0 * np.log10(mine.noise.radiated_j / free.noise.radiated_j)
    assert figures.radiated_db == pytest.approx(change, abs=1e-9)
    assert figures.steps < scene.steps


def test_a_case_takes_the_infinite_plate_where_that_meets_the_accuracy() -> None:
    settings = ["run.duration_s=0.0016", "controller.kappa=0.5"]
    scene = load("aluminium-3mm", settings)
    mine, modal = (figures_of_case(vary(scene, {"run.plate_model": m})) for m in ("auto", "modal"))
    assert (mine.plate_model, modal.plate_model) == ("infinite", "modal")
    assert mine.digest != modal.digest
    assert mine.rebound_m_s == pytest.approx(modal.rebound_m_s, rel=1e-3)
    assert mine.plate_energy_j == pytest.approx(modal.plate_energy_j, rel=2e-3)
    # Not to the end of the run, by when reflections are back; nor at a tighter accuracy.
    assert figures_of_case(scene, "run").plate_model == "modal"
    assert figures_of_case(vary(scene, {"run.accuracy": 1e-5})).plate_model == "modal"


def test_the_span_of_a_run_takes_all_contacts() -> None:
    scene = load("aluminium-20mm", ["run.duration_s=0.006", "controller.law=off", *COARSE])
    assert figures_of_case(scene, "impact").contacts == 1
    assert figures_of_case(scene, "run").contacts > 1


def test_a_case_that_cannot_be_has_a_row_that_says_so() -> None:
    rows = evaluate.run_chunk(
        study.to_toml(load("aluminium-3mm", COARSE)), "impact",
        [(0, {"controller.latency_us": 0.5}), (1, {"controller.latency_us": 1})],
    )  # fmt: skip
    assert "no whole number of steps" in rows[0]["status"]
    assert rows[0]["plate_energy_db"] is None
    assert rows[1]["status"] == ""


SETTINGS = {
    "sensors.bits": [5, 9, "ideal"], "sensors.noise_rms": [0.0, 1e-7],
    "sensors.every_steps": [1, 2], "controller.latency_us": [0, 3, 17],
    "controller.jitter_us": [0, 4], "controller.drop_out_probability": [0.0, 0.2],
    "controller.law": ["slope_threshold", "predicted", "fade_out", "velocity_feedback"],
    "sphere.radius_m": [0.003, 0.006],
}  # fmt: skip


@pytest.mark.parametrize("transport", ["inprocess", "zenoh"])
def test_random_cases_have_the_same_bytes_over_the_bus(transport: str) -> None:
    scene = load("aluminium-3mm", [*COARSE, "run.duration_s=0.0015"])
    axes = tuple(Axis(key, tuple(values)) for key, values in SETTINGS.items())
    design = Design(axes, "lhs", 24, 5)
    rows = [evaluate.run_case(scene, "impact", i, v) for i, v in enumerate(design.cases())]
    assert not any(row["status"] for row in rows)
    assert {row["plate_model"] for row in rows} == {"modal", "infinite"}
    header = study.header_of(scene, design, "impact")
    count = 12 if transport == "inprocess" else 3
    found = list(replay_cases(rows, header, count, transport, 1))
    assert [same for _, same in found] == [True] * count
    # And the comparison can fail.
    wrong = [row | {"controller.latency_us": 1 + row["controller.latency_us"]} for row in rows]
    assert not any(same for _, same in replay_cases(wrong, header, 3, "inprocess", 1))
    other = {"modal": "infinite", "infinite": "modal"}
    wrong = [row | {"plate_model": other[row["plate_model"]]} for row in rows]
    assert not any(same for _, same in replay_cases(wrong, header, 3, "inprocess", 1))


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_results_come_back_with_scene_and_versions(tmp_path: Path, suffix: str) -> None:
    scene = load("aluminium-3mm", COARSE)
    axes = (Axis("sensors.bits", (6, "ideal")), Axis("plate.contact_point_m", ([0.2, 0.2],)))
    out = tmp_path / f"r{suffix}"
    found = study.sweep(scene, Design(axes), "impact", out, workers=1)
    rows, header = study.read_results(out)
    assert [row["sensors.bits"] for row in rows] == [6, "ideal"]
    assert [row["plate.contact_point_m"] for row in rows] == [[0.2, 0.2]] * 2
    assert [row["digest"] for row in rows] == [row["digest"] for row in found.rows]
    assert header["scene_toml"] == study.to_toml(scene)
    assert header["versions"] == study.code_version()
    assert not study.journal_of(out).exists()


def test_other_files_are_no_results(tmp_path: Path) -> None:
    for name in ("a.parquet", "b.csv"):
        (tmp_path / name).write_text("nothing")
        with pytest.raises(ValueError, match="no results of a sweep"):
            study.read_results(tmp_path / name)


@pytest.mark.parametrize("header", ["[1]", "{}", '{"design": {"axes": []}}'])
def test_a_table_with_another_header_is_no_result(tmp_path: Path, header: str) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    (tmp_path / "a.csv.json").write_text(header)
    with pytest.raises(ValueError, match="no results of a sweep"):
        study.read_results(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"garbage\n", "from line 1 on"),
        (b"\xff\n", "from line 1 on"),
        (b"[]\n3\n", "another a"),
        (b'{"a": 1}\n{"x": 1}\n', "from line 2 on"),
    ],
)
def test_a_damaged_journal_is_left_alone_with_a_sentence(
    tmp_path: Path, text: bytes, says: str
) -> None:
    path = tmp_path / "j"
    path.write_bytes(text)
    with pytest.raises(JournalError, match=says):
        Journal(path, {"a": 1})
    assert path.read_bytes() == text


def test_two_sweeps_do_not_write_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with Journal(path, {"a": 1}) as journal:
        journal.add({"case": 0})
        with pytest.raises(JournalError, match="in use by a sweep"):
            Journal(path, {"a": 1})
    with Journal(path, {"a": 1}) as journal:
        assert list(journal.done) == [0]


def test_a_torn_last_line_is_run_again(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with Journal(path, {"a": 1}) as journal:
        journal.add({"case": 0, "x": 1.5})
        journal.add({"case": 1, "x": float("nan")})
    whole = path.read_bytes()
    path.write_bytes(whole[:-4])
    with Journal(path, {"a": 1}) as journal:
        assert list(journal.done) == [0]
        journal.add({"case": 1, "x": float("nan")})
    assert path.read_bytes() == whole


def test_the_journal_of_another_sweep_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with Journal(path, {"span": "impact"}) as journal:
        journal.add({"case": 0})
    before = path.read_bytes()
    with pytest.raises(JournalError, match="another span"):
        Journal(path, {"span": "run"})
    assert path.read_bytes() == before


def _lines(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_bytes().splitlines(keepends=True)[1:]
            if line.endswith(b"\n")]  # fmt: skip


def _wait_for(path: Path, cases: int, process: subprocess.Popen[Any]) -> None:
    deadline = time.monotonic() + 120
    while len(_lines(path)) < cases:
        assert process.poll() is None, "the sweep ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.01)


BIG = ["sweep", "aluminium-3mm", "--set", "run.accuracy=0.05", "--over",
       "controller.latency_us=0:199:1", "--over", "sensors.bits=4:15:1"]  # fmt: skip


def test_a_killed_sweep_goes_on_without_losing_or_repeating_a_case(tmp_path: Path) -> None:
    out = tmp_path / "r.parquet"
    words = command(*BIG, "-o", str(out))
    process = subprocess.Popen(words, start_new_session=True)
    _wait_for(study.journal_of(out), 200, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not out.exists()
    kept = {row["case"]: row for row in _lines(study.journal_of(out))}
    other = subprocess.run([*words, "--over", "controller.kappa=1,2"], capture_output=True)
    assert other.returncode == 2
    assert b"another design" in other.stderr
    report = tmp_path / "r.json"
    subprocess.run([*words, "--json", str(report)], check=True, timeout=280)
    rows, _ = study.read_results(out)
    assert [row["case"] for row in rows] == list(range(2400))
    assert json.loads(report.read_text())["ran"] == 2400 - len(kept)
    assert all(rows[case]["digest"] == row["digest"] for case, row in kept.items())
    again = subprocess.run(words, capture_output=True)
    assert again.returncode == 2  # the results are there already


def _children(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_a_sweep_that_is_killed(tmp_path: Path, sent: signal.Signals) -> None:
    out = tmp_path / "r.csv"
    process = subprocess.Popen(command(*BIG, "-o", str(out), "--workers", "2"))
    _wait_for(study.journal_of(out), 100, process)
    workers = _children(process.pid)
    assert len(workers) >= 2
    process.send_signal(sent)
    process.wait()
    deadline = time.monotonic() + 30
    while any(_runs(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(_runs(pid) for pid in workers)


def test_ctrl_c_ends_a_sweep_with_a_sentence_alone(tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    process = subprocess.Popen(command(*BIG, "-o", str(out), "--workers", "2"),
                               stderr=subprocess.PIPE, start_new_session=True)  # fmt: skip
    _wait_for(study.journal_of(out), 100, process)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.decode().splitlines()[-1].startswith("interrupted; finished cases are kept")
    assert b"Traceback" not in said


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A Dask scheduler and workers, each a process."""
    started = [subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", "--port",
                                 "0", "--host", "127.0.0.1", "--no-dashboard"],
                                stderr=subprocess.PIPE)]  # fmt: skip
    try:
        assert started[0].stderr is not None
        address = ""
        for line in started[0].stderr:
            if b"Scheduler at:" in line:
                address = line.decode().split()[-1]
                break
        for _ in range(workers):
            started.append(
                subprocess.Popen(
                    [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny",
                     "--nthreads", "1", "--no-dashboard"], stderr=subprocess.DEVNULL,
                )
            )  # fmt: skip
        yield address, started[1:]
    finally:
        for process in started:
            process.kill()
            process.wait()


def test_a_dask_cluster_that_loses_a_worker_completes(tmp_path: Path) -> None:
    out, report = tmp_path / "r.csv", tmp_path / "r.json"
    with cluster(2) as (address, workers):
        process = subprocess.Popen(
            command(*BIG, "-o", str(out), "--dask", address, "--json", str(report))
        )
        _wait_for(study.journal_of(out), 200, process)
        workers[0].kill()
        assert process.wait(timeout=250) == 0
    rows, _ = study.read_results(out)
    assert [row["case"] for row in rows] == list(range(2400))
    assert not any(row["status"] for row in rows)
    assert json.loads(report.read_text())["ran"] == 2400


def test_a_lost_scheduler_is_named_and_finished_cases_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    with cluster(1) as (address, _):
        process = subprocess.Popen(
            command(*BIG, "-o", str(out), "--dask", address), stderr=subprocess.PIPE
        )
        _wait_for(study.journal_of(out), 100, process)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 1
    assert b"was lost; finished cases are kept" in said.replace(b"\n", b" ")
    assert b"Traceback" not in said
    assert len(_lines(study.journal_of(out))) >= 100


def test_a_scheduler_that_is_not_there_is_named(tmp_path: Path) -> None:
    found = subprocess.run(
        command("sweep", "--over", "sensors.bits=4,5", "-o", str(tmp_path / "r.csv"),
                "--dask", "tcp://127.0.0.1:1"),
        capture_output=True,
    )  # fmt: skip
    assert found.returncode == 1
    assert b"no Dask scheduler at tcp://127.0.0.1:1" in found.stderr


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["thesis-aluminium"], 2, "run.scheme = 'thesis2008'"),
        (["--out", "folder.csv", "--overwrite"], 2, "folder.csv is a folder"),
        (["--json", "r.csv.json"], 2, "is a file of the results"),
        (["--set", "run.duration_s=0.0009"], 1, "none of the 2 cases has figures"),
        (["--over", "controller.latency_us"], 2, "controller.latency_us=0:100:1"),
    ],
)
def test_mistakes_in_a_sweep_end_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], code: int, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("folder.csv").mkdir()
    usual = ["sweep", "--workers", "1", "--over", "controller.kappa=0,1", "-o", "r.csv"]
    found = CliRunner().invoke(app, [*usual, *words])
    assert found.exit_code == code
    assert says in found.stderr


def test_results_without_a_case_cannot_be_checked(tmp_path: Path) -> None:
    scene = load("aluminium-3mm", [*COARSE, "run.duration_s=0.0009"])
    out = tmp_path / "r.csv"
    study.sweep(scene, Design((Axis("controller.kappa", (0, 1)),)), "impact", out, workers=1)
    found = CliRunner().invoke(app, ["check", str(out)])
    assert found.exit_code == 2
    assert "no case with figures" in " ".join(found.stderr.split())


def test_a_case_is_the_scene_with_its_keys() -> None:
    scene = load("aluminium-3mm")
    same = load("aluminium-3mm", ["controller.law=velocity_feedback", "controller.kappa=0.5"])
    assert vary(scene, {"controller.law": "velocity_feedback", "controller.kappa": 0.5}) == same
