"""Run cases of a sweep again over a transport, and compare the bytes of their samples."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hertzloop.bus.port import BusError
from hertzloop.bus.streams import StreamFault
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes.launcher import RunFailed
from hertzloop.recordings.reader import read
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.cases import digest_of
from hertzloop.results.recorded import truth_of
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, parse
from hertzloop.studies.cases.design import keys_of


@dataclass(frozen=True)
class RepeatedCase:
    """A repeated case: whether its bytes are the same, or why it could not be run."""

    case: int
    same: bool
    not_run: str = ""


def repeat_cases(
    rows: list[dict[str, Any]], header: dict[str, Any], count: int, transport: str, seed: int
) -> Iterator[RepeatedCase]:
    """Run `count` random cases of a sweep's results again. Raises SceneError for a scene in the
    results that is invalid."""
    keys = keys_of(header["design"])
    setup = parse(header["scene_toml"])
    good = [row for row in rows if not row["status"]]
    drawn = np.random.default_rng(seed).permutation(len(good))[:count]
    with TemporaryDirectory() as folder:
        for number in drawn:
            row = good[number]
            try:
                same = _digest(setup, row, keys, transport, Path(folder)) == row["digest"]
            except (RunFailed, BusError, StreamFault, RecordingError, SceneError) as error:
                yield RepeatedCase(row["case"], False, str(error))
            else:
                yield RepeatedCase(row["case"], same)


def _digest(
    setup: Setup, row: dict[str, Any], keys: list[str], transport: str, folder: Path
) -> str:
    """Return the digest of a row's case, run again. Raises the errors of a run."""
    varied = setup.vary({key: row[key] for key in keys})
    case = varied.with_plate_model(row["plate_model"]).with_steps(int(row["steps"]))
    path = folder / "case.mcap"
    run_and_assess(case, path, RunOptions(transport=Transport(transport), overwrite=True))
    recording = read(path)
    coded = case.sensor.bits is not None
    samples = recording.daq.arrays["code" if coded else "value"]
    if coded:
        samples = samples.astype(np.int64)
    return digest_of(truth_of(recording), samples)
