"""Recordings of earlier formats are read: the same samples as protobuf finds in them."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.recordings.reader import read, recover
from hertzloop.setup import parse

OLDER = Path(__file__).parent / "older"
NO_CHECKSUM = (
    "the file is cut off or damaged (the checksum over all data does not fit, or is missing)"
)


@pytest.mark.parametrize(
    ("name", "problems"),
    [
        ("step-constant-force", [NO_CHECKSUM]),  # before there was one, and before f_c1
        ("step-linear-force", []),
    ],
)
def test_an_older_recording(name: str, problems: list[str], tmp_path: Path) -> None:
    path = OLDER / f"{name}.mcap"
    kept = read(path)
    assert kept.problems == problems
    assert "hertzloop" in kept.metadata["versions"]
    assert parse(kept.scene_toml, recorded=True).steps == kept.truth.samples == 4000
    with path.open("rb") as file:
        found = [
            TruthBlock.FromString(message.data)
            for _, _, message in make_reader(file).iter_messages(topics=["/truth"])
        ]
    for field, values in kept.truth.arrays.items():
        assert np.array_equal(values, [x for block in found for x in getattr(block, field)])
    assert ("f_c1_n" in kept.truth.arrays) == (name == "step-linear-force")
    recover(path, tmp_path / "anew.mcap")
    anew = read(tmp_path / "anew.mcap")
    assert anew.truth.arrays["xi_m"].tobytes() == kept.truth.arrays["xi_m"].tobytes()
