"""States of the law over a run, from the events of the controller."""

from hertzloop.bus.events import mode_name
from hertzloop.bus.messages_pb2 import EventKind
from hertzloop.recordings.recording import Recording


def law_states(recording: Recording, controlled: bool = True) -> list[tuple[int, str]]:
    """Return time, ns, and name of each state of the law.

    They come from the events of the controller. Without events, nothing is known of a law other
    than the scene's.
    """
    law = recording.scene_value("controller", "law", "")
    end = recording.ends.get("controller")
    states: list[tuple[int, str]] = []
    for event in recording.events:
        if event.name == "controller" and event.data.kind == EventKind.LAW_MODE:
            if not states:
                states.append((0, mode_name(event.data.mode_before)))
            states.append((event.time_ns, mode_name(event.data.mode)))
    if not states and end and end.report.law not in ("", law):
        return [(0, "not told")]
    return states or [(0, "idle" if controlled else "off")]
