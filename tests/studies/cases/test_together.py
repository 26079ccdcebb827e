"""Cases that are formed in step have the rows that each has alone."""

from collections.abc import Generator

import pytest

from hertzloop.results import cases as parts
from hertzloop.results.cases import together
from hertzloop.scene.setup import load
from hertzloop.studies.cases import evaluate

SCENE = load("aluminium-3mm", ["run.accuracy=0.1", "run.duration_s=0.004"])
NUMBERED = list(enumerate([
    {"controller.latency_us": 0.0},
    {"controller.latency_us": 3.0, "sensors.bits": 8},
    {"controller.latency_us": 0.5},  # no whole number of steps
    {"controller.law": "velocity_feedback", "controller.kappa": 90.0},  # runs away
    {"controller.law": "off"},
    {"controller.nonsense": 1},
    {"run.seed": 3, "sensors.noise_rms": 1e-8},
    {"run.touch_phase": 0.2},
    {"run.touch_phase": 0.9},
    {"sensors.bits": 12},
]))  # fmt: skip


@pytest.mark.usefixtures("warm_kernels")
@pytest.mark.parametrize("span", ["impact", "run"])
def test_rows_are_those_of_each_alone(span: parts.Span) -> None:
    alone = [evaluate.run_case(SCENE, span, *case) for case in NUMBERED]
    found = list(evaluate.run_cases(SCENE, span, NUMBERED))
    assert [row["case"] for row in found] == list(range(len(NUMBERED)))
    assert [repr(row) for row in found] == [repr(row) for row in alone]  # a nan is a nan
    assert [bool(row["status"]) for row in found].count(True) == 3


def steps(log: list[str], name: str, count: int) -> Generator[None, None, str]:
    """A case in so many parts."""
    for part in range(count):
        log.append(f"{name}{part}")
        yield
    if name == "c":
        raise ValueError(name)
    return name


def test_the_same_part_of_all_comes_in_turn() -> None:
    log: list[str] = []
    assert together([steps(log, "a", 2), steps(log, "b", 0), steps(log, "d", 3)]) == ["a", "b", "d"]
    assert log == ["a0", "d0", "a1", "d1", "d2"]
    assert together([]) == []
    with pytest.raises(ValueError, match="c"):
        together([steps(log, "a", 1), steps(log, "c", 1)])
