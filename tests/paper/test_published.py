"""What the study holds beside its tables: optima, appendix A.1, equations 3.1 and 3.8b."""

import math
import random
from pathlib import Path

import numpy as np
import pytest

from hertzloop.scene.setup import load
from paper import equations, optima, tables
from paper import figures as gallery
from paper import table_a1 as appendix
from paper.equations import PointMobility, longhorn_any_j, longhorn_short_j
from tests.benchmarks.programs import called


def test_grid_is_that_of_the_study() -> None:
    configs = optima.grid()
    assert len(configs) == len(set(configs)) == 184
    _, rows = tables.read_rows(Path(tables.__file__).parent / "parameter_study.csv")
    for row in rows:
        wanted = optima.Config(row["force"], float(row["kappa"]), int(row["t_a_step"]))
        assert wanted in configs, row


def test_published_optima_computed_again() -> None:
    """All of tables 5.7 and 5.3 whose rows are there, in the published plant only."""
    chosen = [
        optima.Config(f, k, t) for f, k, t in
        (("F_a3", 0.8, 11), ("F_a6", -1.0, 1), ("F_a7", 0.2, 11), ("F_a10", -0.4, 1),
         ("F_a11", -0.8, 11), ("F_a13", -0.4, 10), ("F_a11", -1.5, 11), ("F_a2", 2, 1),
         ("F_a1", -2, 1), ("F_a6", 2, 1))
    ]  # fmt: skip
    plant = next(iter(optima.PLANTS))
    found = optima.compute_optima(chosen, [plant], lambda done: None)
    rows = [row for row in optima.listed(chosen, found) if row.table == "5.7"]
    assert len(rows) == 54
    off = {f: [abs(r.difference) for r in rows if r.what == f] for f in tables.FIGURES}
    medians = {figure: float(np.median(values)) for figure, values in off.items()}
    assert max(medians[f] for f in ("EAL", "EAH", "pup")) < 0.05
    assert max(medians[f] for f in ("Evib", "vpmax", "Erad")) < 0.2
    assert medians["dT"] < 0.01


def test_ranks_and_ties() -> None:
    configs = [optima.Config("F_a2", k, 1) for k in (0.2, 0.4, 0.6)]
    values = {f: [1.0, 2.0, 3.0] for f in tables.FIGURES}
    published = [{f: values[f][i] for f in values} for i in range(3)]
    other = [{f: -values[f][i] for f in values} for i in range(3)]
    names = list(optima.PLANTS)
    found = {r.figure: r for r in optima.optima(configs, {names[0]: published, names[1]: other})}
    assert found["EAL"].best_published == "F_a2 (0.2, 1)"
    assert (found["EAL"].best_here, found["EAL"].rank_here) == ("F_a2 (0.6, 1)", 3)
    assert found["EAL"].rank_correlation == pytest.approx(-1.0)
    assert found["dT"].best_published == "F_a2 (0.6, 1)"  # the longest contact
    tied = np.array([1.0, 1.004, 1.2, np.nan])
    assert list(optima._best(tied, "EAL")) == [0, 1]


def test_flat_reading_of_the_appendix_comes_close() -> None:
    rows = appendix.computed("flat", "thesis2008")
    found = {a.column: a for a in tables.agreement(rows)}
    assert found["dT"].worst <= 0.1 + 1e-9  # within a step in all rows
    assert found["EAL"].median < 0.05
    assert found["Erad"].median < 0.2
    # As derived, the force of the model is five times F_c0 and far from the table.
    assert appendix.force_n("derived", "thesis2008").max() > 4.0 * appendix.force_n(
        "flat", "thesis2008"
    ).max()  # fmt: skip


def test_longhorn_of_any_contact_time() -> None:
    short = longhorn_short_j(0.003, 0.99)
    assert longhorn_any_j(0.003, 0.99, 1e-10) == pytest.approx(short, rel=1e-4)
    near = [longhorn_any_j(0.003, 0.99, x * 0.003 / 340.0) for x in (0.999e-3, 1.001e-3)]
    assert near[0] == pytest.approx(near[1], rel=3e-6)  # both forms meet
    assert short / longhorn_any_j(0.003, 0.99, 28.94e-6) == pytest.approx(10.3, abs=0.05)


def test_all_of_the_mobility_integral_is_one_whatever_the_plate() -> None:
    drawn = random.Random(4)
    for _ in range(12):
        m, s, z = (10 ** drawn.uniform(*ends) for ends in ((-4, 0), (5, 9), (1, 4)))
        mobility = PointMobility(m, s, z)
        assert mobility.share() == pytest.approx(1.0, abs=1e-6), (m, s, z)
        assert mobility.share(1e-3 * z / m) < 1.0
    impulse = 3.0
    assert mobility.energy_j(impulse, math.inf) == pytest.approx(impulse**2 / 2.0 / m, rel=1e-6)


def test_equations_are_printed(tmp_path: Path) -> None:
    result = called(equations.main, "--set", "run.duration_s=0.0016", "-o", str(tmp_path))
    assert result.exit_code == 0, result.output
    lines = {line.split("│")[2].strip(): line for line in result.output.splitlines() if "│" in line}
    cells = {what: line.split("│")[3].strip() for what, line in lines.items()}
    assert cells["2 m/pi times the integral of Re Y_sys"] == "1"
    assert float(cells["the same for w < 1/T"]) == pytest.approx(0.065, abs=0.001)
    assert float(cells["the same for w < 2 pi/T"]) == pytest.approx(0.96, abs=0.005)
    assert cells["not defined below"] == "170"


@pytest.mark.full
def test_gallery_has_the_figures_that_were_missing(tmp_path: Path) -> None:
    for sheet in gallery.SHEETS.values():
        for curve in sheet.curves:
            for column in sheet.columns:
                source, settings = gallery.COLUMNS[column]
                load(source.format(curve.plate), [*settings, *curve.settings])
    drawn = gallery.draw(tmp_path, only=("3-1-pressure", "5-1-worst-case", "B-1-forces"))
    assert [path.name for path in drawn] == [
        "published-3-1-pressure.png", "published-5-1-worst-case.png", "published-B-1-forces.png",
    ]  # fmt: skip
    for path in drawn:
        assert path.read_bytes().startswith(b"\x89PNG")
