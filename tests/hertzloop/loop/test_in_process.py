"""Runs within one process."""

import pytest

from hertzloop.bus.streams import Envelope
from hertzloop.loop.in_process import record_in_process
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from tests.hertzloop.scenes import aluminium_3mm


def test_a_run_in_one_process_is_reconciled(tmp_path, monkeypatch):
    """Here nobody but the run itself can look at what the recorder heard."""
    honest = Recorder.handle

    def deaf(self: Recorder, envelope: Envelope) -> None:
        if envelope.stream != "balance":
            honest(self, envelope)

    monkeypatch.setattr(Recorder, "handle", deaf)
    scene = aluminium_3mm("run.duration_s=0.0015", "run.accuracy=0.1")
    for compiled in (False, True):
        path = tmp_path / f"{compiled}.mcap"
        with pytest.raises(Exception, match="stream 'balance' is incomplete"):
            record_in_process(scene, path, compiled=compiled)
        assert "stream 'balance' is incomplete" in read(path).result["fault"]
