"""Every kind of event has its sentence."""

from typing import Any

from hertzloop.bus import events
from hertzloop.bus.messages_pb2 import Event, EventKind
from hertzloop.law import ACTING, IDLE, SPENT, WATCHING


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
