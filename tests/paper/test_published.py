"""What the study holds beside its tables: optima, appendix A.1, equations 3.1 and 3.8b."""

import math
import random

import numpy as np
import pytest

from paper import optima, table_a1, tables
from paper.equations import PointMobility, longhorn_any_j, longhorn_short_j


def test_published_optima_computed_again():
    """All of table 5.7, in the published plant only."""
    chosen, plant = optima.quick_grid(), next(iter(optima.PLANTS))
    listed = optima.listed(chosen, optima.compute_optima(chosen, [plant]))
    rows = [row for row in listed if row.table == "5.7"]
    assert len(rows) == 54
    median = {
        figure: np.median([abs(r.difference) for r in rows if r.what == figure])
        for figure in tables.FIGURES
    }
    assert max(median[f] for f in ("EAL", "EAH", "pup")) < 0.05
    assert max(median[f] for f in ("Evib", "vpmax", "Erad")) < 0.2
    assert median["dT"] < 0.01
    (longest,) = (row for row in listed if row.what == "longest T")
    assert longest.best == "the same"
    assert abs(longest.difference) < 0.3


def test_flat_reading_of_the_appendix_comes_close():
    found = {a.column: a for a in tables.agreement(table_a1.computed("flat", "thesis2008"))}
    assert found["dT"].worst <= 0.1 + 1e-9  # within a step in all rows
    assert found["EAL"].median < 0.05
    assert found["Erad"].median < 0.2
    # As derived, the force of the model is five times F_c0 and far from the table.
    derived, flat = (
        table_a1.force_n(reading, "thesis2008").max() for reading in ("derived", "flat")
    )
    assert derived > 4.0 * flat


def test_longhorn_of_any_contact_time():
    short = longhorn_short_j(0.003, 0.99)
    assert longhorn_any_j(0.003, 0.99, 1e-10) == pytest.approx(short, rel=1e-4)
    near = [longhorn_any_j(0.003, 0.99, x * 0.003 / 340.0) for x in (0.999e-3, 1.001e-3)]
    assert near[0] == pytest.approx(near[1], rel=3e-6)  # both forms meet
    assert short / longhorn_any_j(0.003, 0.99, 28.94e-6) == pytest.approx(10.3, abs=0.05)


def test_all_of_the_mobility_integral_is_one_whatever_the_plate():
    drawn = random.Random(4)
    for _ in range(12):
        m, s, z = (10 ** drawn.uniform(*ends) for ends in ((-4, 0), (5, 9), (1, 4)))
        mobility = PointMobility(m, s, z)
        assert mobility.share() == pytest.approx(1.0, abs=1e-6), (m, s, z)
        assert mobility.share(1e-3 * z / m) < 1.0
    impulse = 3.0
    assert mobility.energy_j(impulse, math.inf) == pytest.approx(impulse**2 / 2.0 / m, rel=1e-6)
