"""What a run prints is what `--json` says, in the unit that is printed with it."""

import io
import math
import re

import pytest
from rich.console import Console

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.metric_rows import compared, uncertain
from hertzloop.views.digits import change_text, uncertain_text, value_texts
from hertzloop.views.format import Table
from hertzloop.views.metrics_table import metrics_table
from hertzloop.views.run_json import run_as_json
from tests.commands import invoke
from tests.hertzloop.scenes import aluminium_3mm

UNITS = {
    "nJ": 1e-9, "J": 1.0, "m": 1.0, "kN": 1e3, "mPa": 1e-3,
    "us": 1e-6, "ms": 1e-3, "s": 1.0, "um": 1e-6, "mm": 1e-3, "uJ": 1e-6, "mJ": 1e-3, "m/s": 1.0,
    "Pa": 1.0, "GPa": 1e9, "kHz": 1e3, "N": 1.0, "N/us": 1e6, "W": 1.0, "steps/s": 1.0,
}  # fmt: skip
HEIGHT = ("first_impact", "rebound_height_m")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    settings = [
        "run.duration_s=0.003",
        "contact.plasticity=thornton",
        "actuator.bandwidth_hz=50e3",
    ]
    path = tmp_path_factory.mktemp("printed") / "a.mcap"
    return run_and_assess(aluminium_3mm(*settings), path, RunOptions(transport=Transport.COMPILED))


@pytest.fixture(scope="module")
def report(ran):
    return run_as_json(ran)


def lines(table: Table) -> list[list[str]]:
    """Cells of a table as they are printed, row by row."""
    out = io.StringIO()
    Console(file=out, width=400).print(table)
    return [
        [cell.strip() for cell in re.split("[│┃]", line)[1:-1]]
        for line in out.getvalue().splitlines()
        if line[:1] in "│┃"
    ]


def test_every_metric_is_printed_with_the_label_and_the_digits_of_its_row(ran, report):
    """Values, ranges and changes of both tables are those of --json."""
    result, rows = ran.assessment.result, ran.assessment.rows
    tables = [metrics_table(result, rows), metrics_table(result, rows, details=True)]
    printed = {label: cells for table in tables for label, *cells in lines(table)[1:]}
    assert lines(tables[0])[0][1:] == ["with control", "without", "change"]
    told = {(row["span"], row["label"]): row for row in report["rows"]}
    for label, (own, without, change) in printed.items():
        span = "whole_run" if "whole run" in label else "first_impact"
        row = told[span, label]
        for cell, found in ((own, row["value"]), (without, row["reference"])):
            *_, unit = cell.split() if " " in cell else [cell, ""]
            ends = cell.removesuffix(unit).replace("about ", "").split(" to ")
            for number, end in zip(ends, ("least", "most"), strict=False):
                size = UNITS.get(unit, 1.0) * float(number.replace(",", ""))
                allowed = max(0.006 * abs(found["most"]), found["error"])
                assert size == pytest.approx(found[end], abs=allowed), label
        if row["change"] and row["unit"] in ("dB", "%"):
            low = change.removesuffix(row["unit"]).removeprefix("about ").split(" to ")[0]
            allowed = max(0.51, row["change"]["error"])
            assert float(low.replace(",", "")) == pytest.approx(row["change"]["least"], abs=allowed)


@pytest.mark.parametrize(
    ("value", "error", "others", "shown"),
    [
        (965.4, 0.97, [977.76], "965 to 978"),
        (965.4, 0.97, [965.9], "965"),
        (965.4, 30.0, [977.76], "about 1,000"),
        (20.066, 0.07, [16.998, 19.66], "17.0 to 20.1"),
        (0.12757, 0.005, [0.10087], "0.10 to 0.13"),
        (0.0, 1e-5, [], "0"),
        (5.0, 6.0, [], "unknown"),
        (5.0, math.inf, [7.0], "unknown"),
    ],
)
def test_a_number_has_the_digits_that_its_error_leaves_or_is_a_range(value, error, others, shown):
    assert uncertain_text(uncertain(value, error, others), ".4g", largest=1.0) == shown


def test_a_change_from_zero_is_called_so():
    with_, without = uncertain(1.57e-3, 1e-6), uncertain(0.0, 1e-8)
    [row] = compared({HEIGHT: with_}, {HEIGHT: without})
    assert (change_text(row), value_texts(row)) == ("from 0", ["1.57 mm", "0 mm"])
    [row] = compared({HEIGHT: without}, {HEIGHT: without})
    assert change_text(row) == ""


@pytest.mark.full
def test_no_cell_of_a_table_is_cut(ran):
    """At 80 columns, as in a pipe, words stay whole, too; on less, long ones are broken."""
    recording = str(ran.inspected.recording.path)
    cheap = ["--set", "run.duration_s=0.0015", "--set", "run.accuracy=0.1"]
    commands = [
        ["inspect", recording],
        ["inspect", recording, "--details"],
        ["scene", "keys"],
        ["scene", "keys", "--law", "predicted"],
        ["scene", "check", "aluminium-3mm", *cheap],
    ]
    for words in commands:
        done = invoke(words, env={"COLUMNS": "80"})
        assert done.exit_code == 0, done.output
        assert "│" in done.output, words
        assert "…" not in done.output, words
        ruled = [line for line in done.output.splitlines() if line[:1] in "│┃┏└"]
        assert max(map(len, ruled)) <= 80, words
