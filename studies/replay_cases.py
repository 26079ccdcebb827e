"""Cases of a sweep once more as processes over the bus: are the samples the same bytes?"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from hertzloop.cases import digest_of, lasting, on_plate
from hertzloop.figures import rows_of
from hertzloop.run import RunOptions, Transport, run_scene
from hertzloop.scene import parse, vary
from recordings.reader import read


def replay_cases(
    rows: list[dict[str, Any]], header: dict[str, Any], count: int, transport: str, seed: int
) -> Iterator[tuple[dict[str, Any], bool]]:
    """Run `count` random cases of a sweep's results again; each row, and whether its digest is the
    same. Raises what a run raises."""
    keys = [axis["key"] for axis in header["design"]["axes"]]
    scene = parse(header["scene_toml"])
    good = [row for row in rows if not row["status"]]
    drawn = np.random.default_rng(seed).permutation(len(good))[:count]
    with TemporaryDirectory() as folder:
        for number in drawn:
            row = good[number]
            varied = vary(scene, {key: row[key] for key in keys})
            case = lasting(on_plate(varied, row["plate_model"]), int(row["steps"]))
            path = Path(folder) / "case.mcap"
            run_scene(case, path, RunOptions(transport=Transport(transport), overwrite=True))
            recording = read(path)
            coded = case.sensors.bits != "ideal"
            samples = recording.daq.arrays["code" if coded else "value"]
            if coded:
                samples = samples.astype(np.int64)
            yield row, digest_of(rows_of(recording), samples) == row["digest"]
