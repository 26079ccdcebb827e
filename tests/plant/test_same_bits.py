"""The bytes of a run do not depend on the processor."""

from pathlib import Path

import pytest

from tests.processors import FEW, PROCESSORS, run_digests

SCENES = Path(__file__).parents[1] / "scenes"

THESIS = [(f"thesis-{material}",) for material in ("aluminium", "oak", "sylomer")]


def same(scenes, processors=tuple(PROCESSORS)):
    native, *others = run_digests(scenes, processors).values()
    assert all(other == native for other in others)


def test_a_short_run_of_the_published_scheme():
    same([("thesis-aluminium", "run.duration_s=0.0005")], FEW)


@pytest.mark.full
def test_the_published_scheme_on_all_processors():
    same([*THESIS, (str(SCENES / "relaxation.toml"),), (str(SCENES / "precomputed-thesis.toml"),)])
