"""Later impacts: how far what was before is magnified, and how far runs can be compared."""

import numpy as np
import pytest

from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.recordings.compare import first_difference
from hertzloop.results.comparison import comparison
from hertzloop.results.metric_rows import uncertain_values
from hertzloop.results.metrics import metrics_of
from hertzloop.results.predictability import horizon_step, known_impacts, whole_run_known
from hertzloop.scene.setup import load as load_setup
from hertzloop.views.comparison import PrintedComparison
from hertzloop.views.digits import known_digits
from tests.commands import invoke, succeed
from tests.hertzloop.scenes import aluminium_3mm, json_in, recorded

FOUR = aluminium_3mm("run.duration_s=0.35")


def test_every_bounce_of_a_light_ball_magnifies_what_was_before():
    impacts = metrics_of(FOUR, simulate(FOUR).truth).impacts
    known = known_impacts(FOUR, impacts, 1e-3)
    grown = [each.amplification for each in known]
    assert grown[0] == pytest.approx(2.0, abs=0.3)  # what its energy does to that of the plate
    assert grown[1] > 50.0 * grown[0]
    assert grown[2] > 50.0 * grown[1]
    # At the accuracy of the scene nothing is left of the third's rebound.
    assert known[1].errors["rebound_speed_m_s"] < impacts[1].rebound_speed_m_s
    assert known[2].errors["rebound_speed_m_s"] > impacts[2].rebound_speed_m_s


def test_a_comparison_shows_the_digits_that_are_known():
    metrics = metrics_of(FOUR, simulate(FOUR).truth)
    known = known_impacts(FOUR, metrics.impacts, 1e-3, noise=metrics.noise)
    own = uncertain_values(metrics, 1e-3, known)
    found = PrintedComparison(comparison(own, own))
    energies = {row.span: row for row in found.rows if row.metric == "plate_energy_j"}
    first, whole = energies["first_impact"], energies["whole_run"]
    assert first.a_error == pytest.approx(1e-3 * first.a)
    assert whole.a_error > whole.a
    [first_line, whole_line] = [
        [cell.strip() for cell in line.split("│")[2:5]]
        for line in str(found).splitlines()
        if "plate energy" in line
    ]
    assert first_line == [f"{1e6 * first.a:.0f} uJ"] * 2 + ["+0.0 dB"]
    assert whole_line[:2] == ["unknown"] * 2
    [counted] = [line for line in str(found).splitlines() if "contacts, whole run" in line]
    assert counted.count("unknown") == 3


def test_late_forces_are_no_chaos():
    """A paced run differs from its lock-step by far more than by what its bounces magnify."""
    scene = aluminium_3mm("run.duration_s=0.15")
    metrics = metrics_of(scene, simulate(scene).truth)
    impacts, noise = metrics.impacts, metrics.noise
    paced = [Impact(*(1.01 * value for value in vars(impact).values())) for impact in impacts]
    assert known_impacts(scene, paced, 1e-3, in_lock_step=False) == known_impacts(
        scene, impacts, 1e-3, noise=noise
    )
    more = known_impacts(scene, [*paced, paced[-1]], 1e-3, in_lock_step=False)
    assert more[-1].amplification == np.inf


@pytest.mark.full
def test_what_is_without_control_has_its_digits_where_the_loop_explodes(tmp_path):
    words = ["run", "aluminium-3mm", "--set", "controller.law=velocity_feedback",
             "--set", "controller.kappa=0.3", "--set", "controller.latency_us=6",
             "--set", "run.duration_s=0.15",
             "--transport", "compiled", "--out", str(tmp_path / "a.mcap")]  # fmt: skip
    words += ["--json", str(tmp_path / "a.json")]
    succeed(*words)
    told = json_in(tmp_path / "a.json")
    assert told["stability"]["unstable"]
    assert told["predictability"]["controlled"] is None
    assert told["predictability"]["uncontrolled"][1]["amplification"] > 50.0


def test_the_error_of_the_second_impact_is_what_more_modes_change():
    scene = aluminium_3mm("run.duration_s=0.15")
    finer = aluminium_3mm("run.duration_s=0.15", "run.accuracy=1e-4")
    one, other = (metrics_of(s, simulate(s).truth).impacts for s in (scene, finer))
    known = known_impacts(scene, one, 1e-3)
    for key, error in known[1].errors.items():
        assert abs(vars(one[1])[key] - vars(other[1])[key]) < 2.0 * error, key


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (-1e-9, 0.0, "0.0000"),
        (0.69876, 3e-4, "0.699"),
        (0.69876, 0.7, "unknown"),
        (0.69876, np.inf, "unknown"),
        (248.79, 30.0, "about 200"),
        (0.69876, np.nan, "unknown"),
        (248.79, 3.0, "about 250"),
        (248.79, 0.3, "249"),
        (-32.9, 3.0, "about -30"),
        (2.5e9, 3e8, "about 2e+09"),
        (-99.98, 0.7, "about -100"),
    ],
)
def test_digits(value, error, shown):
    assert known_digits(value, ".4f", error) == shown


def test_the_whole_run_is_known_where_a_run_says_so(here):
    """As the verdict of `run` on later impacts; a sweep and a budget print it as well."""
    assert whole_run_known(load_setup("aluminium-20mm"))
    assert not whole_run_known(FOUR)
    words = ["sweep", "aluminium-3mm", "--over", "controller.latency_us=0,4", "--workers", "1"]
    printed = " ".join(succeed(*words).split())
    assert "At the least plate energy: Later impacts are not predictable." in printed
    assert "over all contacts" not in printed


def test_compare_stops_where_rounding_decides(tmp_path):
    """A run that differs by the rounding of another processor, magnified 1e5 times."""
    keys = ["run.duration_s=0.1", "run.accuracy=0.02", "controller.law=off"]
    heights = ("0.005", "0.005000000000000005")
    scene, nudged = (aluminium_3mm(*keys, f"sphere.drop_height_m={h}") for h in heights)
    a, b = tmp_path / "a.mcap", tmp_path / "b.mcap"
    one, other = recorded(scene, a), recorded(nudged, b)
    horizon = horizon_step(scene, 1e-9)
    assert 0.03 < horizon * 1e-6 < 0.1
    assert first_difference(one, other, 1e-9)
    assert first_difference(one, other, 1e-9, horizon) is None
    assert "Compared up to" in succeed("compare", "--tolerance", "1e-9", str(a), str(b))
    exact = invoke(["compare", str(a), str(b)])
    assert exact.exit_code == 1
