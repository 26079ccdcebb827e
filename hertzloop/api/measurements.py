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
        path: a text table, or a file of another format of `hertzloop fit`.
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
    """Read the measured records of a file: one for each of its `[[record]]` tables, or one.

    Args:
        path: a file of `read_record`, or a TOML file whose `[[record]]` tables name such files.
        table: keys of the tables, which replace those of the file.

    Returns:
        The records, in SI units.

    Raises:
        RecordError: a file cannot be read, or a record cannot be used.
    """
    from hertzloop.fitting.records.reading import read_records

    return read_records(Path(path), table)


@with_parameter_names
def fit(
    scene: AnyScene,
    records: "Record | Sequence[Record]",
    free: Sequence[str],
    *,
    hold_out: "Sequence[Record | int] | None" = None,
    exact: bool = False,
) -> "FitResult":
    """Fit keys of a scene to measured records of drops, with the law off or on.

    Args:
        scene: the scene, or its name or TOML file, with start values.
        records: one record or several; `Record.measurement.control` says whether the law was on.
        free: the keys to fit, `"KEY"`, `"KEY=LOW:HIGH"` or `"KEY±PRIOR"` as on the command line.
        hold_out: records, or numbers of hits, to compare with the fitted scene only; by default the
            last one of several hits.
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
    from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
    from hertzloop.fitting.records.record import Record

    check_list("free", free)
    setup = resolved(scene)
    several = [records] if isinstance(records, Record) else list(records)
    return fit_records(
        setup, several, [parse_free_key(setup, text) for text in free], hold_out, exact=exact
    )
