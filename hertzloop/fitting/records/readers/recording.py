"""Read the samples of hertzloop's own recordings."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.spacing import StatedSpacing
from hertzloop.sensors.acquisition import Filters


def read_recording(path: Path) -> FileContents:
    """Read the samples of a recording; quantity, law and filters are those of its scene.

    Samples behind a gap are not used. Raises RecordError if the first samples are missing.
    """
    from hertzloop.recordings.reader import read
    from hertzloop.scene.setup import parse

    found = read(path)
    setup = parse(found.scene_toml, recorded=True)
    daq = found.daq.from_start()
    if found.problems and not daq.samples:
        raise RecordError(
            f"{path}: the recording is damaged: its first samples are missing. Give a complete "
            "recording."
        )
    notes: list[str] = []
    if daq.samples < found.daq.samples:
        end_ms = 1e3 * daq.samples * setup.every_steps * setup.step_s
        notes.append(f"samples are missing at {end_ms:.6g} ms; later ones are not used.")
    values = np.asarray(daq.values_of(daq.arrays), float)
    lost_forces = bool(found.force.first_step or found.force.resumed)
    pushed = lost_forces or bool(np.any(found.force.arrays.get("force_n", 0.0)))
    inside: dict[str, Any] = {"quantity": setup.quantity, "control": setup.has_law and pushed}
    if not setup.sensor.ideal:
        names = {one.name for one in fields(Filters)}
        if setup.sensor.low_pass_hz is None:
            names -= {"low_pass", "low_pass_order"}
        if setup.sensor.resonance_hz is None:
            names -= {"resonance_damping"}
        of_sensor = {name: getattr(setup.sensor, name) for name in names}
        inside |= {key: value for key, value in of_sensor.items() if value is not None}
    spacing = StatedSpacing(setup.every_steps * setup.step_s, 0.0, "run.step_ns")
    return FileContents(
        [Series("value", "", values, 1)], spacing=spacing, notes=notes, facts=inside
    )
