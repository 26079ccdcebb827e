"""What a run, a node and a repair say at their end."""

import pytest

from hertzloop.views.report import next_lines
from tests.commands import refused, succeed
from tests.hertzloop.commands import (
    WELL_UNDER_WAY,
    Bus,
    ended,
    finish,
    grown_to,
    killed_at_the_end,
    start,
    wait_for,
)

SHORT = ["aluminium-3mm", "--set", "run.duration_s=0.0013"]


@pytest.mark.full
def test_a_run_whose_recording_is_removed_has_failed(tmp_path):
    path = tmp_path / "a.mcap"
    run = start("run", "aluminium-3mm", "--set", "run.duration_s=2", "--out", str(path))
    with killed_at_the_end([run]):
        wait_for(grown_to(path, WELL_UNDER_WAY))
        path.unlink()
        ended(run, 1, f"{path} was removed or renamed while the run wrote it")


@pytest.mark.full
def test_nodes_say_that_they_run_and_what_came_of_it(tmp_path):
    bus, path = Bus("said"), tmp_path / "a.mcap"
    whole = ["aluminium-3mm", "--set", "run.duration_s=0.004"]
    words = {"plant": whole, "controller": [], "recorder": ["--out", str(path)]}
    started = {role: bus.start(role, *words[role]) for role in words}
    with killed_at_the_end(started.values()):
        printed = {}
        for role, process in started.items():
            printed[role] = process.stdout.read()
            code, told = finish_quietly(process)
            assert code == 0, told
            assert f"{role}: running" in told
    assert "Complete: 4,000 steps" in printed["plant"]
    assert "Complete: the plant has ended the run" in printed["controller"]
    assert f"Complete: 4 ms of simulated time in {path}" in printed["recorder"]
    assert "plate energy" in printed["recorder"]
    assert f"Next: hertzloop replay {path}" in printed["recorder"]


def finish_quietly(process):
    """Exit code and standard error of a process whose standard output has been read."""
    process.stdout = None
    return finish(process)


@pytest.mark.parametrize(("path", "shown"), [("-x.mcap", "./-x.mcap"), ("a b.mcap", "'a b.mcap'")])
def test_the_next_command_works_with_any_name(path, shown):
    assert f"hertzloop replay {shown}" in str(next_lines(path)[-1])


def test_a_folder_for_results_that_could_not_be_written_is_removed(tmp_path, monkeypatch):
    succeed("run", *SHORT, "--transport", "compiled", "--out", tmp_path / "a.mcap")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hertzloop.common.atomic_files.os.replace", full)
    folder = tmp_path / "new" / "sounds"
    refused("No space left on device", "listen", tmp_path / "a.mcap", "--out-dir", folder, code=1)
    assert not folder.parent.exists()
