"""The measured and simulated values of a fit as a Rerun recording."""

from pathlib import Path

from hertzloop.common.atomic_files import atomic_write
from hertzloop.fitting.fit.results import FitResult


def write_replay(result: FitResult, path: Path) -> None:
    """Write a Rerun recording (.rrd) with measured and simulated values of every record.
    Raises NotWritten."""
    import rerun as rr

    stream = rr.RecordingStream("hertzloop_fit")
    # By way of memory: a stream that saves to a file on a full disk blocks for ever (0.41).
    memory = stream.memory_recording()
    for record, curve in zip(result.records, result.curves, strict=False):
        times = [rr.TimeColumn("after_touch", duration=curve["time_s"])]
        for name in ("simulated", "measured"):
            stream.send_columns(
                rr.new_entity_path([record.name, record.quantity, name]),
                indexes=times,
                columns=rr.Scalars.columns(scalars=curve[name]),
            )
        stream.send_columns(
            rr.new_entity_path([record.name, "residual"]),
            indexes=times,
            columns=rr.Scalars.columns(scalars=curve["measured"] - curve["simulated"]),
        )
    atomic_write(path, memory.drain_as_bytes())
