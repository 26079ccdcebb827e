"""A metric is as uncertain as the touch phase makes it: where in a step contact begins."""

import pytest

import hertzloop
from hertzloop.results.metric_rows import row_of

SHORT = {"run.duration_s": 0.0015}


def run_of(scene: str, keys: dict[str, object]) -> "hertzloop.Run":
    return hertzloop.simulate(hertzloop.load(scene, keys))


def test_the_range_of_a_run_has_the_metrics_of_runs_at_other_phases():
    """Of the whole run as well, as far as its impacts are predictable; from any phase."""
    keys = {"run.duration_s": 0.02, "run.accuracy": 0.01}
    runs = [run_of("aluminium-20mm", keys | {"run.touch_phase": p}) for p in (0.5, 0.1, 0.9)]
    for span, metric in (
        ("first_impact", "peak_force_n"),
        ("first_impact", "plate_energy_j"),
        ("whole_run", "plate_energy_j"),
        ("whole_run", "contacts"),
    ):
        values = [getattr(getattr(one.metrics, span), metric) for one in runs]
        for one in runs:
            row = row_of(one.rows, span, metric)
            assert row is not None
            assert row.value.least <= min(values)
            assert row.value.most >= max(values)
            if metric == "peak_force_n":
                assert row.value.most > row.value.least
                assert row.change is not None
                assert row.change.most > row.change.least


@pytest.mark.parametrize(
    "keys",
    [
        {"controller.law": "off"},  # no controller samples
        {"run.lead_in_s": 0.0, "controller.v_thr_m_s": -0.6},  # it does not begin in flight
    ],
)
def test_without_a_phase_there_is_no_range(keys):
    known = [row.value for row in run_of("aluminium-3mm", SHORT | keys).rows if row.value.most > 0]
    assert known
    assert all(value.least == value.most for value in known)


def test_the_published_scheme_has_the_digits_of_its_numbers():
    rows = hertzloop.simulate("thesis-aluminium").rows
    assert all(row.value.error == 0.0 for row in rows)
