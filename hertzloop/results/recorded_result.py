"""The result of a recorded run: its metrics with what the recording says beside them."""

from collections.abc import Iterable

from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.recordings.recording import Event, Recording
from hertzloop.results.metrics import Metrics, RunResult, Saturation
from hertzloop.results.recorded import Pacing, RecordedLaw, missing_from
from hertzloop.scene.setup import Setup


def recorded_result(
    setup: Setup, recording: Recording, metrics: Metrics, law: RecordedLaw, pacing: Pacing | None
) -> RunResult:
    """Return the result of a recorded run, whose metrics, law and missed deadlines are known."""
    balance = recording.balance
    return RunResult(
        metrics,
        law.scene_law,
        balance.expected_error if balance else None,
        injected_j=balance.injected_j if balance else 0.0,
        dent_m=balance.dent_m if balance else 0.0,
        late=pacing is not None,
        saturation=saturation_of(recording.events),
        complete=missing_from(recording, setup) is None,
    )


def saturation_of(events: Iterable[Event]) -> Saturation | None:
    """How often, and since when, samples were out of the converter's range where it matters, by a
    recording's events: a gap during a contact, anything else at any time. None if never."""
    since_ns: list[int] = []
    touching = out = counted = of_gap = False
    for event in events:
        if event.name != "plant":
            continue
        kind = event.data.kind
        if kind in (EventKind.CONTACT_BEGAN, EventKind.CONTACT_ENDED):
            touching = kind == EventKind.CONTACT_BEGAN
        elif kind in (EventKind.RANGE_LEFT, EventKind.RANGE_REGAINED):
            out, counted = kind == EventKind.RANGE_LEFT, False
            of_gap = event.data.quantity == "xi"
        matters = touching or not of_gap
        if out and matters and not counted:
            since_ns.append(event.time_ns)
            counted = True
    return Saturation(len(since_ns), since_ns[0] * 1e-9) if since_ns else None
