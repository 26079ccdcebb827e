"""Recorder of a run: checks every message that the bus delivers, and writes it."""

from pathlib import Path
from typing import Any

from hertzloop.bus import sequence_checker, streams
from hertzloop.recordings.file_format import run_metadata
from hertzloop.recordings.writer import RecordingWriter


class Recorder:
    """Checks and writes every message of a run.

    Args:
        path: The file to write.
        overwrite: Whether an existing file is replaced.
        note: Text of the user for the description of the run; empty: none.

    Attributes:
        checker: Checks the sequence of each stream.
        faults: Sentences that the roles announced.
    """

    def __init__(self, path: Path, overwrite: bool = False, note: str = "") -> None:
        self._writer = RecordingWriter(path, overwrite)
        self._note = note
        self.checker = sequence_checker.SequenceChecker()
        self.faults: list[str] = []
        self._ended: dict[str, Any] = {}
        self._time_ns = self._end_ns = 0
        self._scene = ""  # the whole one, if the hello leaves out some of it
        self._closed = False

    @property
    def done(self) -> bool:
        """Whether plant and controller have both ended."""
        return {streams.PLANT, streams.CONTROLLER} <= set(self._ended)

    @property
    def counters(self) -> dict[str, sequence_checker.Counter]:
        """Messages and samples by stream."""
        return self.checker.counters

    def handle(self, envelope: streams.Envelope) -> None:
        """Check and write one message. Raises StreamFault or RecordingError."""
        try:
            block = self.checker.accept(envelope)
        except streams.StreamFault as error:
            raise self.checker.explained(error) from error
        header: Any = block.header
        stream = envelope.stream
        if stream == "hello":
            scene = self._scene or header.scene_toml
            self._writer.scene(scene, run_metadata(header, self._note))
            self._end_ns = header.steps * header.step_ns
        elif stream == "scene":
            self._scene = header.scene_toml
        elif stream == "law":
            self._writer.law(header.source)
        if hasattr(header, "first_step"):
            self._time_ns = header.first_step * header.step_ns
        elif streams.STREAMS[stream].topic == "/events":
            # Not ToNanoseconds(): it refuses times beyond the calendar.
            at = header.timestamp
            self._time_ns = at.seconds * 1_000_000_000 + at.nanos
        elif streams.STREAMS[stream].once:
            self._time_ns = 0 if stream in ("scene", "hello", "law") else self._end_ns
        sequence = self.counters[stream].messages - 1
        self._writer.write(stream, envelope.payload, sequence, self._time_ns)
        if stream.startswith("end/"):
            self._ended[header.role] = header
            if header.fault:
                self.faults.append(header.fault)

    def reconcile(self) -> None:
        """Compare announced and received counts, and the controller's scene with the plant's.

        After a fault that a role announced, a difference is added to `faults`.

        Raises:
            StreamFault: they differ, or a role never announced its end.
        """
        try:
            for role in (streams.PLANT, streams.CONTROLLER):
                if role not in self._ended:
                    raise streams.StreamFault(
                        f"the {role} never announced its end; its last messages may be missing"
                    )
                self.checker.reconcile(self._ended[role])
        except streams.StreamFault as difference:
            if not self.faults:
                raise
            self.faults.append(str(difference))

    def close(self, fault: str = "") -> None:
        """Finish the file; `fault` says why it is not complete, "" if it is."""
        if self._closed:
            return
        self._closed = True
        announced = [words for words in dict.fromkeys([*self.faults, fault]) if words]
        # One role repeats the fault of another, with more words.
        faults = "; ".join(
            words
            for words in announced
            if not any(words in longer for longer in announced if longer != words)
        )
        counts = {name: f"{c.messages} {c.samples}" for name, c in self.counters.items()}
        self._writer.finish({"complete": "no" if faults else "yes", "fault": faults, **counts})
