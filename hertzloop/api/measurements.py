"""Measured records for scripts: read them, and fit a scene to them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hertzloop.api.parameters import with_parameter_names
from hertzloop.api.scenes import AnyScene, resolved
from hertzloop.loop.run_options import check_list

if TYPE_CHECKING:
    from hertzloop.fitting.fit.results import FitResult
    from hertzloop.fitting.records.record import Record


@with_parameter_names
def read_record(path: str | Path, **table: Any) -> "Record":
    """Read a measured record.

    Args:
        path: a text table, a Parquet or NPZ file, or a recording of hertzloop.
        table: keys of the `[record]` table, which replace those of the file.

    Returns:
        The record, in SI units.

    Raises:
        RecordError: the file cannot be read, or the record cannot be used.
    """
    from hertzloop.fitting.records.reading import read_record

    return read_record(Path(path), table)


@with_parameter_names
def read_records(path: str | Path, **table: Any) -> "list[Record]":
    """Read the measured records of a file: one for each `[[record]]` table beside it, or one.

    Args:
        path: a file of `read_record`.
        table: keys of the tables, which replace those of the file.

    Returns:
        The records, in SI units.

    Raises:
        RecordError: a file cannot be read, or a record cannot be used.
    """
    from hertzloop.fitting.records import reading

    return reading.read_records(Path(path), table)


@with_parameter_names
def fit(
    scene: AnyScene,
    records: "Record | str | Path | Sequence[Record | str | Path]",
    free: Sequence[str],
    *,
    hold_out: "Sequence[Record]" = (),
    exact: bool = False,
) -> "FitResult":
    """Fit keys of a scene to measured records of drops, with the law off or on.

    Args:
        scene: the scene, or its name or TOML file, with start values.
        records: one or several, as a `Record` or the path of its file.
        free: the keys to fit, `"KEY"`, `"KEY=LOW:HIGH"` or `"KEY±PRIOR"` as on the command line.
        hold_out: records to compare with the fitted scene only.
        exact: whether the model is taken as exact, so that only noise may spoil a record.

    Returns:
        Estimates with 95 % intervals and verdicts; `setup.scene` is the fitted scene.

    Raises:
        RecordError: a record cannot be used.
        FitError: a key cannot be fitted.
        OptionError: `free` is a text, not a list.
        SceneError: the scene cannot be simulated.
    """
    from hertzloop.fitting.fit.fit import fit as fit_records
    from hertzloop.fitting.fit.free_keys import parse_free_key
    from hertzloop.fitting.records.record import Record

    check_list("free", free)
    setup = resolved(scene)
    given = [records] if isinstance(records, Record | str | Path) else list(records)
    several = [
        found
        for one in given
        for found in ([one] if isinstance(one, Record) else read_records(one))
    ]
    keys = [parse_free_key(setup, text) for text in free]
    return fit_records(setup, several, keys, hold_out, exact=exact)
