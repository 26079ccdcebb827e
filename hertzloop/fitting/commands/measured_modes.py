"""Read measured modes for the command `scene modes`, and print how they were found."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from hertzloop.cli.terminal import fail, out, progress
from hertzloop.common.optional_dependencies import need
from hertzloop.fitting.modes.file_units import units_of, unknown_units
from hertzloop.fitting.modes.frequency_responses import FrequencyResponses
from hertzloop.fitting.modes.from_hits import modes_of_hits
from hertzloop.fitting.modes.from_responses import modes_of_responses
from hertzloop.fitting.modes.hit_responses import read_hits
from hertzloop.fitting.modes.measured_modes import MeasuredModes, ModesCallback
from hertzloop.fitting.modes.response_sets import responses_of_sets
from hertzloop.fitting.modes.universal_file import (
    SUFFIXES,
    Points,
    holds_modes,
    node_of,
    read_sets,
)
from hertzloop.fitting.modes.universal_modes import UniversalModes, modes_of_sets
from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.views.format import Table


@dataclass(frozen=True)
class MeasuredOptions:
    """Options that describe a measured structure, by their names on the command line."""

    contact: str | None
    actuator: str | None
    sensor: str | None
    units: str | None
    direction: Literal["x", "y", "z"] | None
    loss_factor: float | None
    reference: int | None
    unit_modal_mass: bool | None
    kind: str | None
    picture: Path | None
    hold_out: list[Path] | None
    exponential_window: float | None

    def given(self) -> dict[str, Any]:
        """Return the options that were given, by their names."""
        every = {name.replace("_", "-"): value for name, value in asdict(self).items()}
        return {name: value for name, value in every.items() if value is not None}

    @property
    def held(self) -> list[Path]:
        """Files of measurements that are only predicted."""
        return self.hold_out or []


def read_measured_modes(
    paths: list[Path], measured: MeasuredOptions, data: dict[str, Any]
) -> tuple[ModeTable, MeasuredModes | None]:
    """Return the modes of files, and their check, None if the file holds modes itself. What is said
    of them is added to `data`."""
    window_s = measured.exponential_window
    if measured.contact is None:
        fail(_missing_contact(paths[0], measured.kind, measured.units))
    if window_s is not None and not 0.0 < window_s < math.inf:
        fail(
            f"--exponential-window = {window_s:g}: must be positive. Give the time "
            "constant in seconds."
        )
    if paths[0].suffix.lower() in SUFFIXES:
        table, found = _read_universal_file(paths, measured, data)
    else:
        given = measured.given()
        for option in ("actuator", "direction", "kind", "reference", "units"):
            if option in given:
                fail(f"--{option}: records do not have it. Remove the option.")
        at_contact = measured.sensor in (None, measured.contact)
        found = _modes_from_hits(paths, measured.held, at_contact, window_s)
        table = found.table
    if found is not None:
        _print_check(found, data)
    elif measured.held or measured.picture is not None:
        fail("--hold-out, --picture: modes have no measured response. Remove the option.")
    return table, found


def _missing_contact(path: Path, kind: str | None, units: str | None) -> str:
    """What is missing beside --contact, in one sentence each."""
    missing = ["--contact: is missing. Give the node of the contact point; of records, a name."]
    if path.suffix.lower() in SUFFIXES and path.is_file():
        need("pyuff")
        sets = read_sets(path)
        in_units = units_of(sets, path, units)
        if holds_modes(sets, kind, path) and in_units is None:
            missing.append(unknown_units(path))
    return " ".join(missing)


def _read_universal_file(
    paths: list[Path], measured: MeasuredOptions, data: dict[str, Any]
) -> tuple[ModeTable, MeasuredModes | None]:
    """Return the modes of a universal file, and their check if it holds responses."""
    if measured.exponential_window is not None:
        fail("--exponential-window: is for records of hits. Remove the option.")
    if len(paths) != 1:
        fail(f"--from: {len(paths)} files are given. Give one universal file.")
    [path], actuator, sensor = paths, measured.actuator, measured.sensor
    points = Points(
        node_of("contact", measured.contact or ""),
        None if actuator is None else node_of("actuator", actuator),
        None if sensor is None else node_of("sensor", sensor),
        measured.direction,
    )
    need("pyuff")
    sets = read_sets(path)
    in_units = units_of(sets, path, measured.units)
    if not holds_modes(sets, measured.kind, path):
        found = _modes_from_responses(path, sets, points, measured)
        return found.table, found
    modes_found = modes_of_sets(
        sets,
        path,
        points,
        in_units,
        unit_mass=bool(measured.unit_modal_mass),
        loss_factor=measured.loss_factor,
    )
    return _print_file_modes(modes_found, data), None


def _print_file_modes(found: UniversalModes, data: dict[str, Any]) -> ModeTable:
    """Return the modes of a file, say how they were read, and add that to `data`."""
    out.print(f"Direction {found.direction}, units of the file: {found.units.name}.")
    if found.most_complex:
        out.say(
            "The shapes are complex. The imaginary part of the nearest real shapes is at most "
            f"{100 * found.most_complex:.2g} % of the largest value."
        )
    if found.undamped:
        out.print("The file has no damping. Give --loss-factor to set it.")
    data |= {
        "direction": found.direction,
        "units": found.units.name,
        "largest_imaginary_part": found.most_complex,
        "undamped": found.undamped,
    }
    return found.table


def _modes_from_responses(
    path: Path, sets: list[dict[str, Any]], points: Points, measured: MeasuredOptions
) -> MeasuredModes:
    """Return the modes of frequency responses."""
    held = measured.held
    if len(held) > 1:
        fail(f"--hold-out: {len(held)} files are given. Give one universal file.")

    def read(sets: list[dict[str, Any]], path: Path) -> FrequencyResponses:
        in_units = units_of(sets, path, measured.units)
        return responses_of_sets(sets, path, points, in_units, measured.kind, measured.reference)

    responses = read(sets, path)
    other = read(read_sets(held[0], "--hold-out"), held[0]) if held else None
    out.say(
        f"{responses.kind.capitalize()} of the nodes {', '.join(map(str, responses.nodes))} to a "
        f"force at {responses.reference}, direction {responses.direction}, "
        f"{responses.hz[0]:.5g} to {responses.hz[-1]:.5g} Hz."
    )
    with _progress() as on_round:
        return modes_of_responses(responses, other, points, on_round)


def _modes_from_hits(
    paths: list[Path], held: list[Path], at_contact: bool, window_s: float | None
) -> MeasuredModes:
    """Return the modes of records of hits."""
    fitted = _without_held(paths, held)
    hits = [replace(hit, window_s=window_s) for hit in read_hits(fitted)]
    predicted = read_hits(held, "--hold-out") if held else []
    predicted = [replace(hit, window_s=window_s) for hit in predicted]
    with _progress() as on_round:
        return modes_of_hits(hits, predicted, at_contact, on_round)


def _without_held(paths: list[Path], held: list[Path]) -> list[Path]:
    """Return the files whose bytes are not held out. End the command if none is left, or one is
    given twice."""
    out_of_fit = {file.read_bytes() for file in held if file.is_file()}
    found: dict[bytes | Path, Path] = {}
    for path in paths:
        key = path.read_bytes() if path.is_file() else path
        if key in found:
            fail(f"--from {path}: is given twice, as {found[key]}. Name each file once.")
        if key not in out_of_fit:
            found[key] = path
    if not found:
        fail("--hold-out: leaves no file of --from. Hold out fewer.")
    return list(found.values())


@contextmanager
def _progress() -> Iterator[ModesCallback]:
    with progress("modes", 1) as advance:
        yield lambda name, count, error: advance(
            0, f"{name} held out: {count} modes, error {error:.3g}"
        )


def _print_check(found: MeasuredModes, data: dict[str, Any]) -> None:
    """Print the errors of what was held out, and add them to `data`."""
    table = Table("held out", "modes", "error / rms, %", "largest error / peak, %")
    for one in found.held_out:
        table.add_row(one.name, str(one.modes), f"{100 * one.rms:.2f}", f"{100 * one.peak:.2f}")
    out.print(table)
    for note in found.notes:
        out.say(note)
    if found.delay_s:
        data["delay_s"] = found.delay_s
    data["held_out"] = [
        {"name": one.name, "modes": one.modes, "error": one.rms, "largest_error": one.peak}
        for one in found.held_out
    ]
