"""The worst sequence of latencies: found by search, worse than random draws and than few others."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from hertzloop.results.cases import CaseFailed
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.worst.search import MOST_CASES, WorstSearch, case_of, largest
from hertzloop.studies.worst.window import LatencyWindow, window_of
from tests.studies.worst.made_up import SCENE, made_up, simulated

ENERGY = largest("plate_energy_db")


def search_of(setup: Setup) -> WorstSearch:
    return WorstSearch(setup, ENERGY, [0.0], lambda cases: simulated(setup, cases))


def test_the_corner_of_a_sum_is_found():
    setup = load("aluminium-3mm", SCENE)
    weights = np.random.default_rng(3).standard_normal(30)
    found = WorstSearch(setup, ENERGY, [0.0], made_up(weights)).within(4)
    assert found.excess == pytest.approx(4.0 * weights[weights > 0.0].sum())
    assert found.metrics == {"plate_energy_db": found.excess}
    assert found.cases <= MOST_CASES


def test_no_case_is_simulated_twice():
    setup, asked = load("aluminium-3mm", SCENE), list[str]()
    run = made_up(np.random.default_rng(3).standard_normal(30))

    def noted(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
        asked.extend(repr(case) for case in cases)
        return run(cases)

    search = WorstSearch(setup, ENERGY, [0.0, 0.5], noted)
    found = [search.within(steps) for steps in (0, 4, 2, 4)]
    assert len(set(asked)) == len(asked)
    assert search.cases == len(asked) == 1 + sum(one.cases - 1 for one in found)
    assert found[3].excess >= found[1].excess > found[2].excess > found[0].excess


def test_sequences_of_the_caller_are_tried_first():
    setup, weights = load("aluminium-3mm", SCENE), np.tile([1.0, -1.0], 15)
    search = WorstSearch(setup, ENERGY, [0.0], made_up(weights))
    known = np.tile([4, 0], 600)
    found = search.within(4, also=[known])
    assert found.excess == 60.0
    assert found.latencies_us[-30:] == tuple(map(float, known[:30]))


@pytest.mark.parametrize(
    ("state", "value", "excess"),
    [
        ("metrics", 1.5, 1.5),
        ("metrics", float("nan"), -np.inf),
        ("not run", None, -np.inf),
        ("unstable", None, np.inf),
    ],
)
def test_the_largest_value_is_the_worst(state, value, excess):
    assert ENERGY.excess({"plate_energy_db": value, "state": state}) == excess


def test_a_case_that_fails_ends_the_search():
    setup = load("aluminium-3mm", SCENE)
    run = made_up(np.random.default_rng(3).standard_normal(30))

    def fails_late(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
        late = [max(case["controller.latency_trace"]) > 2.0 for case in cases]
        bad = {"plate_energy_db": None, "status": "division by zero", "state": "failed"}
        return [row | bad if late[i] else row for i, row in enumerate(run(cases))]

    search = WorstSearch(setup, ENERGY, [0.0], fails_late)
    assert search.within(2).excess > 0.0
    with pytest.raises(CaseFailed, match="division by zero"):
        search.within(4)


@pytest.mark.parametrize("count", [1, 7, 40])
def test_blocks_cover_a_window(count):
    blocks = LatencyWindow(5, 15, 60).blocks(count)
    ends = [5, *(end for _, end in blocks)]
    assert [first for first, _ in blocks] == ends[:-1]
    assert ends[-1] == 60
    lengths = [end - first for first, end in blocks]
    assert lengths[0] <= lengths[-1]


def test_it_is_as_bad_as_the_worst_of_all_few():
    """All sequences of two samples with three latencies each, by brute force."""
    setup = load("aluminium-3mm", [*SCENE, "sensors.every_steps=20"])
    search = search_of(setup)
    found, window = search.within(2), window_of(setup, 2, search.nominal)
    few = product((0.0, 1.0, 2.0), repeat=3)
    cases = [case_of([0.0] * window.first + list(one) + [0.0] * 9, 0.0) for one in few]
    worst = max(row["plate_energy_db"] for row in simulated(setup, cases))
    assert worst <= found.excess + 1e-12
