"""Events of recordings from before an event held a fact: the sentences of those versions, read.

Only the reader of recordings comes here, and only for an event without a fact.
"""

import re

from bus.events import MODES, Fact
from bus.messages_pb2 import EventKind

_OF_PLANT = (
    (EventKind.CONTACT_BEGAN, re.compile(r"contact (?P<number>[0-9]{1,18}) began")),
    (EventKind.CONTACT_ENDED, re.compile(r"contact (?P<number>[0-9]{1,18}) ended")),
    (EventKind.RANGE_LEFT, re.compile(r"(?P<quantity>\w+) left the converter's range")),
    (EventKind.RANGE_REGAINED, re.compile(r"(?P<quantity>\w+) is back in the converter's range")),
)
_LAW = re.compile(r"law (mode )?(\w+) -> (mode )?(\w+)(, .*)?")


def older_fact(name: str, message: str) -> Fact:
    """The fact in an event of an earlier version; of another sentence, that no more is known."""
    if name == "controller" and (change := _LAW.fullmatch(message)):
        before, mode = _mode(change[2]), _mode(change[4])
        if before is not None and mode is not None:
            return Fact(EventKind.LAW_MODE, mode_before=before, mode=mode)
    for kind, pattern in _OF_PLANT if name == "plant" else ():
        if found := pattern.fullmatch(message):
            said = found.groupdict()
            return Fact(kind, int(said.get("number", 0)), said.get("quantity", ""))
    return Fact()


def _mode(said: str) -> int | None:
    if said in MODES:
        return MODES.index(said)
    return int(said) if re.fullmatch(r"-?[0-9]{1,18}", said) else None
