"""Runs on tape through a checker."""

import re
from collections.abc import Sequence

import pytest

from hertzloop.bus.messages_pb2 import RunEnd
from hertzloop.bus.sequence_checker import SequenceChecker
from hertzloop.bus.streams import Envelope, StreamFault


def feed(sent: Sequence[Envelope]) -> SequenceChecker:
    """The checker after all messages; every end is reconciled."""
    checker = SequenceChecker()
    for envelope in sent:
        block = checker.accept(envelope)
        if isinstance(block.header, RunEnd):
            checker.reconcile(block.header)
    return checker


def refused(sent: Sequence[Envelope], *words: str) -> None:
    """The messages raise a fault that names all the words (patterns)."""
    with pytest.raises(StreamFault) as caught:
        feed(sent)
    for word in words:
        assert re.search(word, str(caught.value)), str(caught.value)
