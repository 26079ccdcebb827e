"""Every kind of event has its sentence."""

from typing import Any

from hertzloop.bus import events
from hertzloop.bus.messages_pb2 import EventKind as Kind

EVENTS: list[tuple[dict[str, Any], str]] = [
    ({"kind": Kind.TEXT, "message": "of another controller"}, "of another controller"),
    ({"kind": Kind.CONTACT_BEGAN, "number": 7}, "contact 7 began"),
    ({"kind": Kind.CONTACT_ENDED, "number": 7}, "contact 7 ended"),
    ({"kind": Kind.RANGE_LEFT, "quantity": "xi"}, "xi left the converter's range"),
    ({"kind": Kind.RANGE_REGAINED, "quantity": "v_p"}, "v_p is back in the converter's range"),
    ({"kind": Kind.LAW_MODE, "mode_before": 0, "mode": 1}, "law idle -> watching"),
    (
        {"kind": Kind.LAW_MODE, "mode_before": 1, "mode": 2, "delay_ns": 11_500},
        "law watching -> acting, threshold crossed, delay 11.5 us",
    ),
    ({"kind": Kind.LAW_MODE, "mode_before": 2, "mode": 9}, "law acting -> mode 9"),
    ({"kind": Kind.RUN_FAILED, "message": "it broke"}, "it broke"),
]


def test_every_kind_of_event_has_its_sentence():
    assert {facts["kind"] for facts, _ in EVENTS} == set(Kind.values())
    for facts, sentence in EVENTS:
        role = "controller" if facts["kind"] == Kind.LAW_MODE else "plant"
        assert events.event(role, 3, 1000, **facts).message == sentence
