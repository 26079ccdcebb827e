"""What the study holds beside its tables: equations 3.1 and 3.8b."""

import math
import random
from pathlib import Path

import pytest

from paper import equations
from paper.equations import PointMobility, longhorn_any_j, longhorn_short_j
from tests.benchmarks.programs import called


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
