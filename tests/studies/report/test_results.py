"""The pages of a sweep and of a tuning: what they say, and that a browser shows them."""

import json
import math
import re

import pytest

from hertzloop.studies.sweep import page as sweep_page
from hertzloop.studies.sweep.results_file import read_results
from tests.commands import call
from tests.studies.report.test_report import BROWSER, in_browser

COARSE = ["--set", "run.accuracy=0.05", "--set", "run.duration_s=0.0016"]
GRID = ["--over", "controller.kappa=0,0.4,0.8", "--over", "controller.latency_us=0:4:2"]
MIXED = ["--over", "controller.law=slope_threshold,off", "--over", "sensors.bits=4:12"]


def done(*words: object) -> str:
    result = call(*words)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder each with a sweep over a grid, one over spread points, and a tuning."""
    folder = tmp_path_factory.mktemp("results")
    for name in ("grid", "mixed"):
        (folder / name).mkdir()
    done("sweep", "aluminium-3mm", *COARSE, *GRID, "--out", folder / "grid" / "g.parquet")
    done("sweep", "aluminium-3mm", *COARSE, *MIXED, "--design", "lhs", "--cases", 6,
         "--out", folder / "mixed" / "m.csv")  # fmt: skip
    done("tune", "aluminium-3mm", *COARSE, "--generations", 1, "--population", 4,
         "--minimise", "plate_energy_db", "--out-dir", folder / "tune")  # fmt: skip
    return folder


@pytest.mark.parametrize(
    ("kind", "name", "says", "charts"),
    [
        ("grid", "g", ["Sweep of aluminium-3mm", "9 cases, a grid", "latency (us)", "Over both",
                       "hertzloop sweep aluminium-3mm.toml --over controller.kappa=0,0.4,0.8 "
                       "--over controller.latency_us=0,2,4 --span impact --out g.parquet"], 2),
        ("mixed", "m", ["6 cases, a Latin hypercube", "bits of the sensor", "--cases 6"], 1),
        ("tune", "tune-aluminium-3mm",
         ["Tuning of aluminium-3mm", "slope threshold (published)", "over touch phases",
          "hertzloop tune aluminium-3mm --minimise plate_energy_db --set run.accuracy=0.05 "], 1),
    ],
)  # fmt: skip
def test_a_folder_of_results_becomes_a_page(results, tmp_path, kind, name, says, charts):
    page = tmp_path / f"{name}.html"
    assert str(page) in done("report", results / kind, "-o", tmp_path)
    text = page.read_text()
    assert len(text) < 10e6
    loaded = re.findall(r"""(?:src|href)\s*=\s*["']([^"']{1,60})""", text)
    assert all(target.startswith(("data:", "#")) for target in loaded), loaded
    for words in says:
        assert words in text
    assert text.count("<svg") == charts
    if BROWSER is None:
        pytest.skip("no Chromium here: apt install chromium")
    found, console = in_browser(page)
    assert console == []
    drawn = re.search(r'data-drawn-after-ms="(\d+)"', found)
    assert drawn
    assert int(drawn[1]) < 5000


def test_a_tuning_reads_as_it_was_written(results, tmp_path):
    from hertzloop.studies.tune.result import read_tuned, write_tuned

    tuned = read_tuned(results / "tune" / "tune-aluminium-3mm.json")
    assert tuned.front
    write_tuned(tmp_path / "again.json", tuned)
    again = json.loads((tmp_path / "again.json").read_text())
    assert again == json.loads((results / "tune" / "tune-aluminium-3mm.json").read_text())


def test_what_is_no_result_is_refused_with_a_sentence(results, tmp_path):
    (tmp_path / "two").mkdir()
    (tmp_path / "tune-x.json").write_text("{}")
    for name in ("a", "b"):
        source = results / "grid" / "g.parquet"
        (tmp_path / "two" / f"{name}.parquet").write_bytes(source.read_bytes())
    (tmp_path / "empty").mkdir()
    for source, says in (
        (tmp_path / "empty", "holds no results of a sweep or a tuning"),
        (tmp_path / "two", "holds 2 results (a.parquet, b.parquet). Name one of them"),
        (tmp_path / "tune-x.json", "holds no results of a tuning"),
        (tmp_path / "none.csv", "there is no such file"),
    ):
        result = call("report", source, "-o", tmp_path / "out")
        assert result.exit_code == 2
        assert says in result.output


def test_a_metric_without_a_value_or_a_change_is_left_out(results, monkeypatch):
    file = results / "grid" / "g.parquet"
    rows, header = read_results(file)
    changed = [{**row, "radiated_db": math.nan, "pressure_db": -1e-4} for row in rows]
    monkeypatch.setattr(sweep_page, "read_results", lambda path: (changed, header))
    text = sweep_page.sweep_page(file).html()
    assert "nan" not in re.findall(r"<td>([^<]*)</td>", text)
    assert "pressure at 1 m" not in re.sub("<p>Left out.*</p>", "", text)
    [said] = re.findall("<p>Left out: (.*)</p>", text)
    assert "adiated energy" in said
    assert "no value in any case" in said
    assert ": 0.000 in every case" in said.replace("-0", "?")
    assert len(re.findall("<th>", text)) == 5 + 6  # least and largest; case, keys, metrics, status
