"""Export of a recording to the format that the name of the new file says."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from hertzloop.common.atomic_files import NotWritten, whole_file
from hertzloop.recordings.export.samples import Samples
from hertzloop.recordings.export.scalars import write_mcap
from hertzloop.recordings.export.tables import columns_file, write_columns, write_csv, write_parquet
from hertzloop.recordings.writer import RecordingError

FORMATS: dict[str, Callable[[Samples, Path], None]] = {
    ".mcap": write_mcap,
    ".parquet": write_parquet,
    ".csv": write_csv,
}


def outputs(path: Path) -> list[Path]:
    """The files that an export to `path` writes."""
    return [path, columns_file(path)] if path.suffix == ".csv" else [path]


def export(samples: Samples, path: Path) -> None:
    """Write the samples to a file, all or nothing: what exists is replaced by a whole one only.

    Raises RecordingError if the recording cannot be read on or the file not be written.
    """
    try:
        with ExitStack() as files:
            unfinished, *beside = (files.enter_context(whole_file(one)) for one in outputs(path))
            FORMATS[path.suffix](samples, unfinished)
            for one in beside:
                write_columns(samples, one)
    except NotWritten as error:
        raise RecordingError(str(error)) from error
