"""Appendix A.1: the force F_a,Y of a simplified impact model, and its table computed again.

The printed formula leaves open how the optimum is taken, how it comes back into time and what
kappa scales. Three readings are tried; each lasts as long as F_c0, as the constant force does.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.cli.terminal import out
from hertzloop.controller.laws.precomputed import mobility_force_n
from hertzloop.loop.simulate import simulate
from hertzloop.results.impacts import first_impact
from paper.tables import (
    UNITS,
    Row,
    SchemeOption,
    agreement,
    beside,
    compute,
    read_rows,
    scene_of,
)

TABLE = Path(__file__).parent / "table_a1.csv"
FLAT = 0.55  # of max(F_c0): inferred from the published table, not printed in the study
READINGS = {
    "derived": "F_c of mass, spring and infinite plate, as derived; its own size",
    "derived, scaled": f"the same, scaled to {FLAT} max(F_c0), which is inferred",
    "flat": f"constant, {FLAT} max(F_c0), which is inferred",
}
LEFT_OUT = (
    "table A.1, how the optimum is taken and brought back into time: not printed; of figure A.1 "
    "only the axis is left"
)


def force_n(reading: str, scheme: str) -> np.ndarray:
    """F_a,Y for kappa = 1, N, one value a step, as long as F_c0.

    F_c0 is that of the aluminium plate. Raises ValueError without an impact.
    """
    setup = scene_of(Row("aluminium", 0.05, ("controller.law=off",), True), scheme)
    impact = first_impact(setup, simulate(setup).truth)
    if impact is None:
        raise ValueError(f"{setup.scene.name}: no impact")
    length, top = len(impact.contact_n), FLAT * float(impact.contact_n.max())
    if reading == "flat":
        return np.full(length, top)
    shape = np.zeros(length)
    part = mobility_force_n(setup.law)[:length]
    shape[: len(part)] = part
    return shape if reading == "derived" else shape * (top / shape.max())


def computed(reading: str, scheme: str) -> list[dict[str, str]]:
    """The published rows with X_computed and X_difference after every figure X."""
    unit = force_n(reading, scheme)
    found = []
    for number, cells in enumerate(read_rows(TABLE), 1):
        forces = (float(cells["kappa"]) * unit).tolist()
        settings = ("controller.law=profile", f"controller.profile_n={forces}")
        figures = compute(Row("aluminium", 0.05, settings, True), scheme)
        found.append(beside(cells, figures, number))
    return found


def main(
    folder: OutDirOption = None,
    scheme: SchemeOption = "thesis2008",
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Compute table A.1, the force of a simplified model, by each reading of its formula.

    The printed formula is incomplete. With --quick: the flat reading only.

    Example: python -m paper.table_a1 --quick
    """
    readings = ("flat",) if quick else tuple(READINGS)
    data: dict[str, Any] = {}
    found = {}
    with results_in(folder, "table_a1", scheme, json_file=json_file) as results:
        for reading in tracked("readings", readings):
            rows = computed(reading, scheme)
            found[reading] = agreement(rows)
            data[reading] = {"rows": rows, "agreement": [asdict(a) for a in found[reading]]}
            out.say(f"{reading}: {READINGS[reading]}")
            cells = (row.values() for row in rows)
            results.write_rows(f"table_a1-{reading.replace(', ', '-')}", list(rows[0]), cells)
        results.add(scheme=scheme, **data)
        results.table(
            f"Table A.1 by {scheme}: differences, median and worst of 8 rows",
            {
                "figure": lambda line: f"{line[0].column} ({UNITS.get(line[0].column, 'dB')})",
                **{
                    reading: f"{{0[{i}].median:.2f}}, {{0[{i}].worst:.2f}}"
                    for i, reading in enumerate(found)
                },
            },
            zip(*found.values(), strict=True),
        )
        out.say(f"cannot be reproduced: {LEFT_OUT}")
        off = {
            reading: max(a.median for a in each if a.column not in UNITS)
            for reading, each in found.items()
        }
        best = min(off, key=off.__getitem__)
        results.conclude(
            f"The reading '{best}' comes closest to table A.1: its levels differ by a median of "
            f"{off[best]:.2f} dB or less."
        )


if __name__ == "__main__":
    start("paper.table_a1")
