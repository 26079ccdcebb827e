"""One door to all formats of an export: the ending of the file's name says which."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from recordings.export.arrays import write_hdf5, write_npz
from recordings.export.per_sample import write_mcap
from recordings.export.samples import Samples
from recordings.export.tables import write_csv, write_parquet
from recordings.writer import RecordingError

FORMATS: dict[str, Callable[[Samples, Path], None]] = {
    ".mcap": write_mcap, ".parquet": write_parquet, ".csv": write_csv, ".npz": write_npz,
    ".h5": write_hdf5,
}  # fmt: skip


def export(samples: Samples, path: Path) -> None:
    """Write the samples to a file, all or nothing: what exists is replaced by a whole one only.

    Raises RecordingError if the recording cannot be read on or the file not be written.
    """
    write = FORMATS[path.suffix]
    try:
        handle, name = tempfile.mkstemp(path.suffix, f".{path.stem}-", path.parent)
        os.close(handle)
        unfinished = Path(name)
        try:
            write(samples, unfinished)
            mask = os.umask(0)
            os.umask(mask)
            unfinished.chmod(0o666 & ~mask)  # as any file, not only for its owner
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(f"cannot write {path}: {error.strerror or error}") from error
