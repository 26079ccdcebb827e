"""Sentences are for people: with every word of them replaced, programs find the same facts."""

import re
from pathlib import Path
from typing import Any

import pytest

from hertzloop.bus import events
from hertzloop.bus.messages_pb2 import Event, EventKind
from hertzloop.law import ACTING, IDLE, SPENT, WATCHING
from hertzloop.loop import in_process
from hertzloop.loop.plant_streams import BLOCK_STEPS
from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay.law_states import law_states
from hertzloop.results.cases import CaseState
from hertzloop.results.metrics import Saturation
from hertzloop.results.verdict import saturation_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.sweeps.design import Axis, Design
from hertzloop.studies.sweeps.evaluate import run_cases
from hertzloop.studies.sweeps.sweep import SweepResults, header_of, read_results, write_results
from tests.commands import invoke, run_and_inspected

SHORT = ["run.duration_s=0.0015", "run.accuracy=0.1"]
RUNS = {
    "out of range": ["sensors.bits=12", "sensors.full_scale=[-5e-6, 1e-5]"],
    "unstable": [
        "controller.law=velocity_feedback",
        "controller.kappa=0.3",
        "controller.latency_us=6",
        "run.duration_s=0.01",
    ],
    "cut off": ["run.duration_s=0.00101"],
}
FOR_PEOPLE = {"message", "status", "wall_s", "real_time_factor", "measured_ratio",
              "file", "recording", "messages"}  # fmt: skip


def replaced(text: str) -> str:
    """A sentence with other words and numbers."""
    return re.sub(r"\w+", "quux", text)


def without(data: Any) -> Any:
    """Data without what is there for people, and without what the speed of this machine decides:
    times, and into how many messages a stream is cut."""
    if isinstance(data, dict):
        return {key: without(value) for key, value in data.items() if key not in FOR_PEOPLE}
    return [without(value) for value in data] if isinstance(data, list) else data


def recorded(name: str, folder: Path) -> tuple[Recording, list[Any]]:
    """One of RUNS in a new folder, and what `run` and `inspect` write of it."""
    folder.mkdir()
    found = run_and_inspected(folder, *SHORT, *RUNS[name])
    return read(folder / "a.mcap"), [written for _, written in found]


@pytest.mark.parametrize("name", RUNS)
def test_a_run_with_other_words_has_the_same_data(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(in_process, "EVERY_S", 60.0)
    usual, known = recorded(name, tmp_path / "usual")
    true = events.sentence
    monkeypatch.setattr(events, "sentence", lambda event: replaced(true(event)))
    monkeypatch.setattr(in_process, "EVERY_S", 0.0)  # as on a slow machine: a block each 1000 steps
    strange, found = recorded(name, tmp_path / "strange")
    assert usual.truth.messages <= 2
    assert strange.truth.messages == -(-strange.truth.samples // BLOCK_STEPS)
    assert [e.message for e in strange.events] == [replaced(e.message) for e in usual.events]
    assert len(usual.events) > 1
    assert [e.data for e in strange.events] == [e.data for e in usual.events]
    assert without(found) == without(known)
    assert law_states(strange) == law_states(usual)
    assert saturation_of(strange.events) == saturation_of(usual.events)
    assert isinstance(saturation_of(usual.events), Saturation) == (name == "out of range")
    assert first_difference(usual, strange, tolerance=1e-12) is None


def test_a_sweep_with_other_words_counts_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load("aluminium-3mm", [*SHORT, "controller.law=velocity_feedback"])
    values = (0.1, 3.0, 1e9)  # the last one is refused
    design = Design((Axis("controller.kappa", values),), "grid", 3, 1)

    def swept(file: Path) -> tuple[SweepResults, list[dict[str, Any]]]:
        rows = list(run_cases(scene, "run", list(enumerate(design.cases()))))
        write_results(file, rows, header_of(scene, design, "run"))
        return SweepResults(rows, 3, 0.0, []), read_results(file)[0]

    usual, read_again = swept(tmp_path / "a.csv")
    true = SceneError.__str__
    monkeypatch.setattr(SceneError, "__str__", lambda error: replaced(true(error)))
    strange, strangely_read = swept(tmp_path / "b.csv")
    states = [CaseState.METRICS, CaseState.UNSTABLE, CaseState.NOT_RUN]
    for outcome, rows in ((usual, read_again), (strange, strangely_read)):
        assert [row["state"] for row in outcome.rows] == [row["state"] for row in rows] == states
        assert (outcome.unstable, len(outcome.not_run)) == (1, 1)
    assert [row["status"] for row in strange.rows] == [replaced(r["status"]) for r in usual.rows]
    assert without(strangely_read) == without(read_again)
    done = invoke(["report", str(tmp_path / "a.csv"), "--out-dir", str(tmp_path)])
    assert done.exit_code == 0, done.output


def every_event() -> list[Event]:
    """One of each kind, and more of those with several forms."""
    late = {
        "from_step": 5,
        "to_step": 5,
        "late_sequences": 1,
        "longest_sequence": 1,
        "oldest_steps": 3,
    }
    facts: list[dict[str, Any]] = [
        {"kind": EventKind.TEXT, "message": "of another controller"},
        {"kind": EventKind.CONTACT_BEGAN, "number": 7},
        {"kind": EventKind.CONTACT_ENDED, "number": 7},
        {"kind": EventKind.RANGE_LEFT, "quantity": "xi"},
        {"kind": EventKind.RANGE_REGAINED, "quantity": "v_p"},
        {"kind": EventKind.FORCES_LATE, "number": 4, "last_number": 4, **late},
        {"kind": EventKind.FORCES_LATE, "number": 4, "last_number": 9, **late, "to_step": 99},
        {"kind": EventKind.LAW_MODE, "mode_before": 0, "mode": 1},
        {"kind": EventKind.LAW_MODE, "mode_before": 1, "mode": 2, "delay_ns": 11_500},
        {"kind": EventKind.LAW_MODE, "mode_before": 2, "mode": 9},
        {"kind": EventKind.RUN_FAILED, "message": "the controller left the run"},
    ]
    publishers = ["controller" if f["kind"] == EventKind.LAW_MODE else "plant" for f in facts]
    return [events.event(who, 3, 1000, **f) for who, f in zip(publishers, facts, strict=True)]


def test_every_kind_of_event_has_its_sentence() -> None:
    found = every_event()
    assert {event.kind for event in found} == set(EventKind.values())
    assert [event.message for event in found] == [
        "of another controller",
        "contact 7 began",
        "contact 7 ended",
        "xi left the converter's range",
        "v_p is back in the converter's range",
        "late force 4: the force of step 2 acted in step 5",
        "late forces 4 to 9: 6 of the steps 5 to 99 used an older force, in 1 sequences of at most "
        "1 steps; the oldest force was 3 steps old",
        "law idle -> watching",
        "law watching -> acting, threshold crossed, delay 11.5 us",
        "law acting -> mode 9",
        "the controller left the run",
    ]


def test_a_law_has_the_modes_that_have_names() -> None:
    numbers = {"idle": IDLE, "watching": WATCHING, "acting": ACTING, "spent": SPENT}
    assert {name: events.MODES.index(name) for name in events.MODES} == numbers
