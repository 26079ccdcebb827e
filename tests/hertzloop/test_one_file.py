"""Two runs and one file: one is refused, and what a run reports is its own."""

import subprocess
import sys
from pathlib import Path

import pytest

from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.plant_node import LoopStats
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes import record as recording
from hertzloop.processes.record import what_is_kept
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError, RecordingWriter
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import Setup, load
from tests.hertzloop.processes import LONG, finish, grown_to, hertzloop, next_line, start, wait_for

SHORT = ["run.duration_s=0.0025", "run.accuracy=0.1"]


@pytest.mark.full
def test_a_second_run_does_not_take_the_file_of_the_first(tmp_path: Path) -> None:
    """Both may overwrite; the first one goes on and keeps its recording."""
    out = tmp_path / "one.mcap"
    first = start("run", *LONG, "--out", str(out), "--overwrite")
    try:
        wait_for(grown_to(out, 500_000), 120.0)
        size = out.stat().st_size
        second = hertzloop(
            "run", "aluminium-3mm", "--set", SHORT[0], "--out", str(out), "--overwrite"
        )
        assert second.returncode == 1, second.stdout
        assert f"another run is writing {out}" in " ".join(second.stderr.split())
        assert out.stat().st_size >= size
    finally:
        first.send_signal(2)
        finish(first)
    assert read(out).metadata["steps"] == "15000000"


def test_of_two_runs_started_together_one_reports(tmp_path: Path) -> None:
    out = tmp_path / "one.mcap"
    words = (
        "run",
        "aluminium-3mm",
        "--set",
        "run.duration_s=0.5",
        "--out",
        str(out),
        "--overwrite",
    )
    codes = sorted(finish(run, 200.0)[0] for run in [start(*words), start(*words)])
    # The second is refused, unless the first was over before it began.
    assert codes in ([0, 1], [0, 0])
    assert read(out).problems == []


def test_a_lock_goes_with_its_process(tmp_path: Path) -> None:
    out = tmp_path / "one.mcap"
    script = (
        "import sys, time; from pathlib import Path;"
        "from hertzloop.recordings.writer import RecordingWriter;"
        "w = RecordingWriter(Path(sys.argv[1])); w.scene('# a', {}); print('here', flush=True);"
        "time.sleep(100)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", script, str(out)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert next_line(holder) == "here\n"
        with pytest.raises(RecordingError, match="another run is writing"):
            RecordingWriter(out, overwrite=True)
    finally:
        holder.kill()
        holder.wait()
    writer = RecordingWriter(out, overwrite=True)
    writer.scene("# b", {})
    writer.finish({})
    assert read(out).scene_toml == "# b"


def test_a_report_is_of_the_run_that_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replaced(scene: Setup, path: Path, *_: object, **__: object) -> LoopStats:
        stats = record_in_process(scene, path, compiled=True)
        record_in_process(scene, path, RunOptions(overwrite=True), compiled=True)
        return stats

    monkeypatch.setattr(recording, "record_in_process", replaced)
    with pytest.raises(RecordingError, match="another run has replaced it"):
        run_and_assess(
            load("aluminium-3mm", SHORT),
            tmp_path / "run.mcap",
            RunOptions(transport=Transport.COMPILED),
        )


def test_a_run_that_never_began_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    old, new = tmp_path / "old.mcap", tmp_path / "new.mcap"
    record_in_process(load("aluminium-3mm", SHORT), old, compiled=True)
    content = old.read_bytes()
    since_s = old.stat().st_mtime + 1.0
    RecordingWriter(old, overwrite=True).finish({"fault": "nobody came"})
    RecordingWriter(new).finish({"fault": "nobody came"})
    assert old.read_bytes() == content
    assert not new.exists()
    assert what_is_kept(old, since_s) == "no recording was written"
    assert what_is_kept(old, 0.0) == f"the recording up to now is in {old}"
    for strange in (b"", b"text", content[:100]):
        new.write_bytes(strange)
        assert what_is_kept(new, 0.0) == "no recording was written"
    assert what_is_kept(tmp_path / "none.mcap", 0.0) == "no recording was written"
