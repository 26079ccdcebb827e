"""Events of a run: typed facts with the sentence that a person reads, in one message.

The sentences are made here and nowhere else, and no program reads them: a fact is in the fields.
"""

from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log

from hertzloop.bus.messages_pb2 import Event, EventKind

MODES = ("idle", "watching", "acting", "spent")  # of a law; it may have more


def event(name: str, step: int, step_ns: int, level: Any = Log.INFO, **fact: Any) -> Event:
    """An event of publisher `name` at a simulated step; `fact`: fields of `Event`."""
    message = Event(level=level, name=name, **fact)
    message.timestamp.FromNanoseconds(step * step_ns)
    message.message = message.message or sentence(message)
    return message


def sentence(event: Event) -> str:
    """An event in words."""
    match event.kind:
        case EventKind.CONTACT_BEGAN:
            return f"contact {event.number} began"
        case EventKind.CONTACT_ENDED:
            return f"contact {event.number} ended"
        case EventKind.RANGE_LEFT:
            return f"{event.quantity} left the converter's range"
        case EventKind.RANGE_REGAINED:
            return f"{event.quantity} is back in the converter's range"
        case EventKind.LAW_MODE:
            words = f"law {mode_name(event.mode_before)} -> {mode_name(event.mode)}"
            if event.HasField("delay_ns"):
                words += f", threshold crossed, delay {event.delay_ns / 1000:g} us"
            return words
    return str(event.message)


def mode_name(mode: int) -> str:
    """A law's mode in words; a law may have more than those that have a name."""
    return MODES[mode] if 0 <= mode < len(MODES) else f"mode {mode}"
