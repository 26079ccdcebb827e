"""What a run prints is what `--json` says, in the unit that is printed with it."""

import io
import math
import operator
import re
from dataclasses import fields, replace

import pytest
from rich.console import Console

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.views.details import run_table
from hertzloop.views.effects import table_of
from hertzloop.views.format import Table
from hertzloop.views.impacts_table import impacts_table
from hertzloop.views.noise_table import noise_rows, noise_table
from hertzloop.views.run_json import run_as_json
from tests.commands import invoke
from tests.hertzloop.scenes import aluminium_3mm

UNITS = {
    "us": 1e-6, "ms": 1e-3, "s": 1.0, "um": 1e-6, "mm": 1e-3, "uJ": 1e-6, "mJ": 1e-3, "m/s": 1.0,
    "Pa": 1.0, "GPa": 1e9, "kHz": 1e3, "N": 1.0, "N/us": 1e6, "W": 1.0, "steps/s": 1.0,
}  # fmt: skip
NOISE = {
    "contact time": "contact_time_s",
    "next impact speed": "next_impact_speed_m_s",
    "rebound height": "rebound_height_m",
    "acceleration noise, Longhorn": "longhorn_j",
    "acceleration noise, Holmes": "holmes_j",
    "peak pressure bound at 1 m": "peak_pressure_pa",
    "transmitted energy, in time": "transmitted_j",
    "transmitted energy, by spectrum": "transmitted_spectrum_j",
    "largest plate speed": "plate_speed_max_m_s",
    "sigma E to 20 kHz, eq. 3.12 (study)": "radiated_j",
    "sigma E to 20 kHz, eq. 3.13": "radiated_maidanik_j",
    "radiated to 20 kHz, eq. 3.12": "sound_j",
    "radiated to 20 kHz, eq. 3.13": "sound_maidanik_j",
}
IMPACT = {
    "start": "start_s",
    "duration": "duration_s",
    "impact": "impact_speed_m_s",
    "rebound": "rebound_speed_m_s",
    "peak force": "peak_force_n",
    "plate energy": "plate_energy_j",
    "plate speed": "plate_speed_max_m_s",
}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    settings = [
        "run.duration_s=0.003",
        "contact.plasticity=thornton",
        "plate.radiation=one_face",
        "actuator.bandwidth_hz=50e3",
    ]
    path = tmp_path_factory.mktemp("printed") / "a.mcap"
    return run_and_assess(aluminium_3mm(*settings), path, RunOptions(Transport.COMPILED))


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


def quantities(words: str) -> list[float]:
    """All numbers with a unit, in SI."""
    units = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
    found = re.findall(rf"(-?[0-9][0-9.,]*(?:e[-+]?[0-9]+)?) ({units})\b", words)
    return [float(number.replace(",", "")) * UNITS[unit] for number, unit in found]


@pytest.mark.full
def test_what_the_run_leaves_out(ran, report):
    _, *rows = lines(table_of(ran.assessed.result.metrics.neglected.checks))
    sides = set()
    for (name, _, value, asked, state), found in zip(rows, report["validity"], strict=True):
        words = {"left out": "neglected", "not known": "unknown"}
        assert (name, state) == (found["name"], words.get(found["state"], found["state"]))
        side, threshold = asked.split()
        if value:
            assert float(value) == pytest.approx(found["value"], rel=0.05)
        assert float(threshold) == pytest.approx(found["threshold"], rel=0.05)
        if state in ("within", "neglected", "out of range"):
            meets = operator.gt if side == ">" else operator.lt
            assert meets(found["value"], found["threshold"]) == (state == "within"), name
            sides.add(side)
    assert sides == {"<", ">"}


@pytest.mark.full
def test_noise(ran, report):
    own, free = report["noise"][0], report["uncontrolled"]["noise"][0]
    cases = [
        ("with", ran.assessed.result.metrics.noise[0]),
        ("without", ran.assessed.free.noise[0]),
    ]
    header, *rows = lines(noise_table(cases))
    assert header[1:] == ["with", "without", "change"]
    assert {row[0] for row in rows} == set(NOISE)
    for label, with_control, without, change in rows:
        values = own[NOISE[label]], free[NOISE[label]]
        found = [*quantities(with_control), *quantities(without)]
        assert found == pytest.approx(values, rel=6e-4), label
        ratio = values[0] / values[1]
        if change.endswith("%"):
            assert float(change[:-2]) == pytest.approx(100 * (ratio - 1.0), abs=0.051)
        else:
            of_amplitude = label.startswith(("peak pressure", "largest plate"))
            decibel = (20 if of_amplitude else 10) * math.log10(ratio)
            assert float(change[:-3]) == pytest.approx(decibel, abs=0.0051)
    assert len(lines(noise_table(cases, False))[0]) == 3


@pytest.mark.full
def test_impacts(ran, report):
    header, *rows = lines(impacts_table("Impacts", ran.assessed.result.metrics.impacts))
    for heading, *cells in zip(header, *rows, strict=True):
        words, unit = re.fullmatch(r"(.+) \((.+)\)", heading).groups()  # type: ignore[union-attr]
        for cell, impact in zip(cells, report["impacts"], strict=True):
            assert float(cell) * UNITS[unit] == pytest.approx(impact[IMPACT[words]], rel=6e-4)


def test_a_change_in_per_cent_has_a_sign_as_in_the_short_table():
    without = ImpactNoise(**{field.name: 1.0 for field in fields(ImpactNoise)})
    under = replace(without, contact_time_s=0.447, next_impact_speed_m_s=1e4)
    rows = {row[0]: row[-1] for row in noise_rows([under, without], compare=True)}
    assert rows["contact time"] == "-55.3 %"
    assert rows["next impact speed"] == "from nearly zero"
    assert rows["rebound height"] == "+0.0 %"
    back = replace(without, next_impact_speed_m_s=-0.2)
    rows = {row[0]: row[-1] for row in noise_rows([under, back], compare=True)}
    assert rows["next impact speed"] == ""


@pytest.mark.full
def test_the_run(ran, report):
    rows = {label: words for label, words in lines(run_table(ran))}
    assert "scheme" not in rows
    printed = {label: quantities(words) for label, words in rows.items()}
    demand, limit = report["demand"], report["limiting_pressure"]
    expected = {
        "wall time": [report["wall_s"], report["steps"] / report["wall_s"]],
        "actuator demand": [
            demand["force_n"],
            demand["slew_n_s"],
            demand["power_w"],
            demand["delay_s"],
        ],
        "yield": [report["yield"]["dent_m"], report["yield"]["dissipated_j"]],
        "radiation": [report["radiation"]["dissipated_j"]],
        "limiting pressure": [limit["pressure_pa"], limit["by"]["value_pa"]],
        "truncated modes": [report["truncated_modes"]["lost_j"]],
    }
    assert demand["delay_s"] > 0.0
    for label, values in expected.items():
        assert printed[label] == pytest.approx(values, rel=6e-3), label
    assert printed["plate model"][0] == pytest.approx(report["frequency_limit_hz"], rel=6e-4)
    assert rows["steps"] == f"{report['steps']:,}"
    assert "one face" in rows["radiation"]
    of_study = replace(ran, setup=aluminium_3mm("run.scheme=thesis2008"))
    assert "flaws included" in dict(lines(run_table(of_study)))["scheme"]


@pytest.mark.full
def test_no_cell_of_a_table_is_cut(ran):
    """At 80 columns, as in a pipe, words stay whole, too; on less, long ones are broken."""
    recording = str(ran.recording.path)
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


def test_the_details_of_a_run_have_the_mean_latency_under_jitter(tmp_path):
    words = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0015", "--details", "--overwrite"]
    words += ["--transport", "inprocess", "--out", str(tmp_path / "a.mcap")]
    jittery = invoke([*words, "--set", "controller.jitter_us=20"], env={"COLUMNS": "200"})
    (row,) = [line for line in jittery.output.splitlines() if "mean latency" in line]
    assert 15.0 < float(row.split("mean latency")[1].strip(" │").split()[0]) < 16.0, row
    assert "mean latency" not in invoke(words).output
