"""The plant as a linear system: agreement with python-control, and the cost of a margin."""

import time
from dataclasses import asdict, dataclass

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
    write_records,
    written,
)
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.setup import load
from hertzloop.studies.margin.identify import law_filter
from hertzloop.studies.margin.linear import plant_in_flight
from hertzloop.studies.margin.margin import loop_of
from hertzloop.studies.margin.poles import closed_loop_poles
from hertzloop.studies.margin.system import LinearSystem

_LAW = ("controller.law=velocity_feedback", "controller.kappa=0.4", "run.lead_in_s=0.01")
_QUANTITIES = ("v_p", "acceleration", "xi")
# Scene and points of the resonance grid: python-control needs seconds a point at 449 modes.
_COMPARED = (("oak-20mm", 450), ("aluminium-20mm", 40))
# Name and settings; the plate decides how many modes there are.
_PLATES = (
    ("aluminium-3mm", ()),
    ("... plate of 0.77 m by 0.49 m", ("plate.size_m=[0.77, 0.49]",)),
)
_LATENCIES = 201


@dataclass(frozen=True)
class Agreement:
    """Largest difference from python-control's frequency response, relative to the largest
    value."""

    scene: str
    quantity: str
    modes: int
    points: int
    difference: float


@dataclass(frozen=True)
class MarginCost:
    """Processor time, s: of the table, of all latencies from it, and of all closed-loop poles at
    latency 0. `counted` and `found`: poles outside the unit circle by the table and by the
    poles."""

    scene: str
    modes: int
    table_s: float
    latencies_s: float
    poles_s: float
    counted: int
    found: int


def compare(scene: str, points: int, quantity: str) -> Agreement:
    """Compare the frequency response on the resonance grid."""
    import control

    system = LinearSystem.of(load(scene, _LAW), quantity)
    grid_hz = system.resonance_grid_hz()
    grid_hz = grid_hz[:: max(1, len(grid_hz) // points)]
    ours = system.frequency_response(grid_hz)
    theirs = control.frequency_response(system.to_control(), 2.0 * np.pi * grid_hz).frdata
    away = float(np.abs(np.ravel(theirs) - ours).max() / np.abs(ours).max())
    return Agreement(scene, quantity, len(system.poles), len(grid_hz), away)


def cost(name: str, settings: tuple[str, ...]) -> MarginCost:
    """Time the margin of velocity feedback."""
    setup = load("aluminium-3mm", [*_LAW, *settings])
    plant, law = plant_in_flight(setup), law_filter(setup)
    loop_of(plant, law, 1, 0)  # compiles
    began = time.process_time()
    loop = loop_of(plant, law, 1, 0)
    made = time.process_time()
    counts = loop.table.unstable(np.arange(1, _LATENCIES + 1))
    answered = time.process_time()
    poles = closed_loop_poles(loop.plant, loop.law, 1)
    ended = time.process_time()
    found = -1 if poles is None else int(np.sum(np.abs(poles) > 1.0))
    return MarginCost(
        name, len(plant.poles), made - began, answered - made, ended - answered, int(counts[0]),
        found,
    )  # fmt: skip


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Compare the plant as a linear system with python-control, and time the margin.

    With --quick there is one scene of each.

    Example: python -m benchmarks.linear_system --quick
    """
    check_json(json_file)
    some = 1 if quick else None
    with results_in(folder, "linear_system") as made:
        need("control")
        asked = [(scene, points, quantity) for scene, points in _COMPARED[:some]
                 for quantity in _QUANTITIES]  # fmt: skip
        agreement = [compare(*one) for one in tracked("python-control", asked)]
        costs = [cost(*one) for one in tracked("margin", _PLATES[:some])]
        write_records(made / "agreement.csv", agreement)
        write_records(made / "cost.csv", costs)
        bars(made / "linear_system.png", "Difference from python-control",
             "relative to the largest value",
             [(f"{a.scene}, {a.quantity}", a.difference) for a in agreement], log=True)  # fmt: skip
    rows = [(a.scene, a.quantity, str(a.modes), str(a.points), f"{a.difference:.1e}")
            for a in agreement]  # fmt: skip
    headings = ("scene", "quantity", "modes", "points", "difference")
    out.print(number_table("frequency response", headings, rows, text=2))
    times = [(c.scene, str(c.modes), f"{c.table_s:.3f}", f"{c.latencies_s:.4f}", f"{c.poles_s:.3f}",
              str(c.counted), str(c.found)) for c in costs]  # fmt: skip
    names = ("scene", "modes", "table, s", f"{_LATENCIES} latencies, s", "all poles, s",
             "outside, counted", "found")  # fmt: skip
    out.print(number_table("processor time of a margin", names, times, text=1))
    written(made, "agreement.csv", "cost.csv", "linear_system.png")
    last = costs[-1]
    conclude(
        f"The frequency response is within {max(a.difference for a in agreement):.1e} of "
        f"python-control's, and {_LATENCIES} latencies of {last.modes:,} modes take "
        f"{last.table_s + last.latencies_s:.2f} s."
    )
    write_json(json_file, {"agreement": [asdict(a) for a in agreement],
                           "cost": [asdict(c) for c in costs]})  # fmt: skip


if __name__ == "__main__":
    start("benchmarks.linear_system")
