"""Probabilities of a goal: intervals and uncertain inputs."""

import math

import numpy as np
import pytest
import scipy

from hertzloop.results.cases import CaseState
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import load
from hertzloop.studies.budget.goal import METRICS, parse_goal
from hertzloop.studies.budget.probability import FIRST, Draws, probability, wilson
from hertzloop.studies.cases.axis import Axis
from hertzloop.studies.cases.design import Design
from hertzloop.studies.cases.evaluate import evaluate
from hertzloop.studies.cases.uncertain import UncertainInput, with_draws
from hertzloop.studies.cases.uncertain_file import read_uncertain, uncertain_of
from hertzloop.studies.sweep.results_file import read_results
from tests.commands import call, succeed

SHORT = ["run.duration_s=0.0016", "controller.law=force_feedback"]


def test_the_wilson_interval_is_that_of_the_formula():
    assert wilson(8, 10) == pytest.approx((0.4901625, 0.9433178), abs=1e-6)
    assert (wilson(0, 10)[0], wilson(10, 10)[1]) == (0.0, 1.0)


def exact_coverage(truth: float, within: float, most: int = 4096) -> float:
    """Return how often the interval holds a probability when cases double until half the interval
    is at most `within`: the sum over all numbers of successes at which drawing stops."""
    cases, covered = FIRST, 0.0
    going = scipy.stats.binom.pmf(np.arange(cases + 1), cases, truth)
    while True:
        for met in np.flatnonzero(going):
            low, high = wilson(int(met), cases)
            if 0.5 * (high - low) <= within or cases >= most:
                covered += going[met] if low <= truth <= high else 0.0
                going[met] = 0.0
        if not going.any():
            return float(covered)
        more = min(cases, most - cases)
        going = np.convolve(going, scipy.stats.binom.pmf(np.arange(more + 1), more, truth))
        cases += more


def test_the_interval_holds_probabilities_that_are_not_rare_in_93_to_97_percent():
    # With a fixed number of cases the coverage is a sum of binomial probabilities.
    held = [met for met in range(129) if wilson(met, 128)[0] <= 0.892 <= wilson(met, 128)[1]]
    fixed = sum(math.comb(128, met) * 0.892**met * 0.108 ** (128 - met) for met in held)
    assert exact_coverage(0.892, 0.5) == pytest.approx(fixed, rel=1e-9)
    covered = [exact_coverage(0.01 * percent, 0.03) for percent in range(5, 96)]
    assert min(covered) >= 0.93
    assert max(covered) <= 0.97


def test_distributions_have_their_quantiles():
    numbers = {
        "uniform": (2.0, 4.0),
        "triangular": (0.0, 1.0, 4.0),
        "normal": (1.0, 2.0),
        "log_normal": (3.0, 0.5),
        "values": (1.0, 5.0, 9.0),
    }
    median = {
        "uniform": 3.0,
        "triangular": 4.0 - math.sqrt(6.0),
        "normal": 1.0,
        "log_normal": 3.0,
        "values": 5.0,
    }
    for kind, given in numbers.items():
        part = UncertainInput(("a.b",), kind, given)
        assert part.at([0.5])["a.b"] == pytest.approx(median[kind])
        drawn = [part.at([(i + 0.5) / 500])["a.b"] for i in range(500)]
        assert sorted(drawn) == drawn


@pytest.mark.full
def test_probability_is_recorded_and_narrow_enough(pool):
    setup = load("aluminium-3mm", SHORT)
    table = {"controller.latency_us": {"distribution": "uniform", "low": 0, "high": 8}}
    goal = parse_goal("plate_energy_db <= -3")
    found = probability(
        setup,
        [goal],
        Draws(uncertain_of(table, setup), within=0.08),
        lambda cases: evaluate(pool, setup, "impact", cases),
    )
    assert found.cases in (128, 256)
    assert 0.5 * (found.interval[1] - found.interval[0]) <= 0.08
    assert len(found.drawn) == found.cases
    again = evaluate(pool, setup, "impact", [found.worst])[0]
    assert again["plate_energy_db"] == found.worst_metrics["plate_energy_db"]
    assert found.interval[0] < found.value < found.interval[1]


def test_a_case_with_an_unstable_linear_loop_misses_the_goals():
    setup = load("aluminium-3mm", SHORT)
    table = {"controller.latency_us": {"distribution": "values", "values": [0, 1, 2, 3]}}
    metrics = {"plate_energy_db": -9.0, "status": "", "state": CaseState.METRICS}

    def run(cases):
        return [dict.fromkeys(METRICS, 0.0) | metrics | case for case in cases]

    found = probability(
        setup,
        [parse_goal("plate_energy_db <= -3")],
        Draws(uncertain_of(table, setup), most=64),
        run,
        stable=lambda case: case["controller.latency_us"] < 3,
    )
    late = [case for case in found.drawn if case["controller.latency_us"] == 3]
    assert 0 < len(late) < 64
    assert (found.met, found.unstable) == (64 - len(late), len(late))
    assert found.worst["controller.latency_us"] == 3


@pytest.mark.parametrize(
    ("data", "word"),
    [({}, "no key"), ({"a.b": {"distribution": "cauchy"}}, "unknown"),
     ({"sphere.radius_m": {"distribution": "normal", "mean": 1.0}}, "needs mean"),
     ({"sphere.radius_m": {"distribution": "uniform", "low": 2, "high": 1}}, "increase"),
     ({"sphere.radius_m": {"distribution": "values", "values": 5}}, "values = 5: must be a list"),
     ({"correlated": [{"keys": ["a.b"]}]}, "correlated.distribution = None: is unknown")],
)  # fmt: skip
def test_distributions_that_make_no_sense_are_refused(data, word):
    with pytest.raises(SceneError, match=word):
        uncertain_of(data, load("aluminium-3mm"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("uncertain = 3", "uncertain = 3: must be a table of scene keys"),
        ('[fit]\nkeys = ["a"]', "fit.values: Field required. Write the scene again"),
        ("a = ", "cannot be read"),
    ],
)
def test_a_file_of_distributions_that_cannot_be_is_refused(tmp_path, text, said):
    path = tmp_path / "u.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=said):
        read_uncertain(path, load("aluminium-3mm"))


def test_a_scene_holds_its_own_distributions(tmp_path):
    scene = tmp_path / "mine.toml"
    plain = call("scene", "show", "aluminium-3mm").stdout
    scene.write_text(
        plain + '[uncertain]\n"plate.thickness_m" = { distribution = "normal", '
        "mean = 0.003, standard_deviation = 1e-5 }\n"
    )
    setup = load(str(scene))
    assert setup.scene == load(str(scene)).scene
    assert read_uncertain(scene, setup).keys == ["plate.thickness_m"]
    over, uncertain = Axis("plate.thickness_m", (0.003, 0.004)), read_uncertain(scene, setup)
    with pytest.raises(SceneError, match="is drawn by --uncertain"):
        with_draws(setup, Design((over,)), uncertain, 3)
    words = ["sweep", str(scene), "--set", SHORT[0], "--over", "controller.latency_us=0,2",
             "--uncertain", str(scene), "--cases", "4", "--workers", "1",
             "--out", str(tmp_path / "a.csv")]  # fmt: skip
    said = succeed(*words)
    rows, header = read_results(tmp_path / "a.csv")
    assert len({row["digest"] for row in rows}) == len(rows) == 8
    drawn = {row["plate.thickness_m"] for row in rows}
    at = header["design"]["drawn_keys"].index("plate.thickness_m")
    assert {one[at] for one in header["design"]["drawn"]} == drawn
    assert len(drawn) == 4
    assert "Over draws of the uncertain keys" in said
