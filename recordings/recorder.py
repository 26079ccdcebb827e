"""The recorder: checks every stream it hears, writes it down, reconciles the counts."""

from pathlib import Path
from typing import Any

from bus.streams import CONTROLLER, PLANT, STREAMS, Checker, Counter, Envelope, StreamFault
from recordings.writer import RecordingWriter, described_by


class Recorder:
    """Feed it every message of a run; `done` once both roles have announced their end."""

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        self._writer = RecordingWriter(path, overwrite)
        self.checker = Checker()
        self.faults: list[str] = []
        self._ended: dict[str, Any] = {}
        self._time_ns = self._end_ns = 0
        self._closed = False

    @property
    def done(self) -> bool:
        """Whether plant and controller have both ended."""
        return {PLANT, CONTROLLER} <= set(self._ended)

    @property
    def counters(self) -> dict[str, Counter]:
        """Messages and samples by stream."""
        return self.checker.counters

    def handle(self, envelope: Envelope) -> None:
        """Check and write one message. Raises StreamFault or RecordingError."""
        try:
            block = self.checker.accept(envelope)
        except StreamFault as error:
            raise self.checker.explained(error) from error
        header: Any = block.header
        stream = envelope.stream
        if stream == "hello":
            self._writer.scene(header.scene_toml, described_by(header), header.law_source)
            self._end_ns = header.steps * header.step_ns
        if hasattr(header, "first_step"):
            self._time_ns = header.first_step * header.step_ns
        elif STREAMS[stream].topic == "/events":
            # Not ToNanoseconds(): it refuses what is out of the calendar.
            at = header.timestamp
            self._time_ns = at.seconds * 1_000_000_000 + at.nanos
        elif STREAMS[stream].once and stream != "hello":
            self._time_ns = self._end_ns
        sequence = self.counters[stream].messages - 1
        self._writer.write(stream, envelope.payload, sequence, self._time_ns)
        if stream.startswith("end/"):
            self._ended[header.role] = header
            if header.fault:
                self.faults.append(header.fault)

    def reconcile(self) -> None:
        """Compare announced and received counts, and what the controller worked by with what the
        plant announced. Raises StreamFault for a difference or a role that never announced its
        end; after a fault that one announced, a difference is noted beside it."""
        try:
            for role in (PLANT, CONTROLLER):
                if role not in self._ended:
                    raise StreamFault(
                        f"the {role} never announced its end; its last messages may lack"
                    )
                self.checker.reconcile(self._ended[role])
        except StreamFault as difference:
            if not self.faults:
                raise
            self.faults.append(str(difference))

    def close(self, fault: str = "") -> None:
        """Finish the file, whatever has happened; `fault` says why it is not complete."""
        if self._closed:
            return
        self._closed = True
        told = [words for words in dict.fromkeys([*self.faults, fault]) if words]
        # One role passes on what another has said.
        faults = "; ".join(f for f in told if not any(f in more for more in told if more != f))
        counts = {name: f"{c.messages} {c.samples}" for name, c in self.counters.items()}
        self._writer.finish({"complete": "no" if faults else "yes", "fault": faults, **counts})
