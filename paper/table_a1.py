"""Appendix A.1: the force F_a,Y of a simplified impact model, and its table computed again.

The printed formula leaves open how the optimum is taken, how it comes back into time and what
kappa scales. Three readings are tried; each lasts as long as F_c0, as the constant force does.
"""

from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.controller.laws.precomputed import mobility_force_n
from hertzloop.loop.simulate import simulate
from hertzloop.results.impacts import first_impact
from paper.tables import (
    FIGURES,
    LEFT_OUT,
    UNITS,
    Row,
    SchemeOption,
    agreement,
    compute,
    read_rows,
    scene_of,
    with_differences,
    write_table,
)

TABLE = Path(__file__).parent / "table_a1.csv"
FLAT = 0.55  # of max(F_c0): inferred from the published table, not printed in the study
READINGS = {
    "derived": "F_c of mass, spring and infinite plate, as derived; its own size",
    "derived, scaled": f"the same, scaled to {FLAT} max(F_c0), which is inferred",
    "flat": f"constant, {FLAT} max(F_c0), which is inferred",
}


@dataclass(frozen=True)
class Model:
    """F_c0 of a plant and what the simplified model makes of it, N, one value a step."""

    contact_n: np.ndarray
    mobility_n: np.ndarray


@lru_cache(maxsize=4)
def model(scheme: str) -> Model:
    """The aluminium plate without control. Raises ValueError without an impact."""
    row = Row("aluminium", 0.05, ("controller.law=off",), True)
    setup = scene_of(row, scheme)
    impact = first_impact(setup, simulate(setup).truth)
    if impact is None:
        raise ValueError(f"{setup.name}: no impact")
    about = setup.about_mechanics
    return Model(impact.contact_n, mobility_force_n(about))


def force_n(reading: str, scheme: str) -> np.ndarray:
    """F_a,Y for kappa = 1, N, one value a step, as long as F_c0."""
    found = model(scheme)
    length, top = len(found.contact_n), FLAT * float(found.contact_n.max())
    if reading == "flat":
        return np.full(length, top)
    shape = np.zeros(length)
    part = found.mobility_n[:length]
    shape[: len(part)] = part
    return shape if reading == "derived" else shape * (top / shape.max())


def computed(reading: str, scheme: str) -> list[dict[str, Any]]:
    """The published rows with X_computed and X_difference after every figure X."""
    _, rows = read_rows(TABLE)
    unit = force_n(reading, scheme)
    found = []
    for number, cells in enumerate(rows, 1):
        forces = [float(x) for x in float(cells["kappa"]) * unit]
        settings = ("controller.law=profile", f"controller.profile_n={forces}")
        row = Row("aluminium", 0.05, settings, True)
        figures = compute(row, scheme)
        found.append({**cells, **with_differences(cells, figures, number)})
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
    check_json(json_file)
    readings = {"flat": READINGS["flat"]} if quick else READINGS
    data: dict[str, Any] = {}
    names = []
    with results_in(folder, "table_a1", scheme) as made:
        for reading, words in tracked("readings", readings.items()):
            rows = computed(reading, scheme)
            data[reading] = {"rows": rows, "agreement": [asdict(a) for a in agreement(rows)]}
            out.print(f"{reading}: {words}", soft_wrap=True)
            names.append(f"table_a1-{reading.replace(', ', '-')}.csv")
            write_table(made / names[-1], list(rows[0]), rows)
        sizes = [
            (f"{a['column']} ({UNITS.get(a['column'], 'dB')}), {reading}", float(a["median"]))
            for reading, each in data.items()
            for a in each["agreement"]
        ]
        names.append("table_a1.png")
        bars(made / "table_a1.png", f"Table A.1 by {scheme}",
             "median difference, in the unit of the label", sizes, log=True)  # fmt: skip
    cells = []
    for i, figure in enumerate(FIGURES):
        found = [each["agreement"][i] for each in data.values()]
        unit = UNITS.get(figure, "dB")
        cells.append((
            f"{figure} ({unit})", *(f"{a['median']:.2f}, {a['worst']:.2f}" for a in found)
        ))  # fmt: skip
    title = f"Table A.1 by {scheme}: differences, median and worst of 8 rows"
    out.print(number_table(title, ("figure", *data), cells, text=1))
    out.print(f"cannot be reproduced: {LEFT_OUT[2]}", soft_wrap=True)
    written(made, *names)
    off = {
        reading: max(a["median"] for a in each["agreement"] if a["column"] not in UNITS)
        for reading, each in data.items()
    }
    best = min(off, key=off.__getitem__)
    conclude(
        f"The reading '{best}' comes closest to table A.1: its levels differ by a median of "
        f"{off[best]:.2f} dB or less."
    )
    write_json(json_file, {"scheme": scheme, **data})


if __name__ == "__main__":
    start("paper.table_a1")
