"""Where methods fail: blow up, or lose the energy.

Limits of free vibration (`stability_limits`), energy over stiffness, mass, plate speed and loss
factor (`stability_maps`).
"""

import math
from collections.abc import Callable, Iterable

from benchmarks.before_after import BeforeOption, draw_stability
from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import Results, results_in
from benchmarks.stability_limits import LIMITS, growth
from benchmarks.stability_maps import (
    Outcome,
    contact_drift,
    loss_map,
    mass_map,
    shaken_map,
    stiffness_map,
    thesis_contact,
)
from benchmarks.stability_pictures import BALANCED, draw_energy, draw_limits
from hertzloop.cli.terminal import out

_MAPS: dict[str, Callable[[int], list[Outcome]]] = {
    "stiffness": stiffness_map,
    "mass": mass_map,
    "shaken": shaken_map,
    "loss": loss_map,
}
_QUICK = 5  # each n-th point of every map


def run(results: Results, quick: bool) -> tuple[dict[str, str], str]:
    """Measure all; write two pictures and a CSV file for each map.

    Steps are over the contact time of the same sphere on a rigid plate.

    Args:
        results: takes the files.
        quick: take each fifth point of every map; these have the values of the whole map.

    Returns:
        Key metrics to print, and the conclusion.
    """
    every = _QUICK if quick else 1
    free = list(growth(every))
    contact = contact_drift(every)
    thesis = list(thesis_contact(every))
    outcomes = {name: measure(every) for name, measure in tracked("stability", _MAPS.items())}
    results.write_rows("stability-growth", ("scheme", "omega_h", "growth_per_step"), free)
    results.write("stability-contact", contact)
    columns = ("step", "contact_length", "energy_residual", "momentum_residual")
    results.write_rows("stability-thesis2008", columns, thesis)
    for name, found in outcomes.items():
        results.write(f"stability-{name}", found)
    draw_limits(results.path("stability.png"), free, contact, thesis)
    draw_energy(results.path("stability-energy.png"), outcomes)
    metrics = _of_limits(free) | _of_balance(outcomes) | _of_thesis(thesis)
    return metrics, conclusion(outcomes, thesis)


def conclusion(
    outcomes: dict[str, list[Outcome]], thesis: list[tuple[float, float, float, float]]
) -> str:
    """How well the default scheme keeps its energy on all maps, in one sentence."""
    mine = [one for found in outcomes.values() for one in found if one.scheme == "modal"]
    worst = max(abs(one.change) for one in mine)
    return (
        f"At steps of {min(o.step for o in mine):.2g} to {max(o.step for o in mine):.3g} contact "
        f"times the energy residual of the default scheme is at most {worst:.1e}; that of the "
        f"published scheme reaches {max(row[2] for row in thesis):.2g}."
    )


def _of_limits(free: Iterable[tuple[str, float, float]]) -> dict[str, str]:
    found = {}
    for scheme, limit in LIMITS.items():
        grows = [phase for name, phase, factor in free if name == scheme and factor > 1.0 + 1e-9]
        found[f"{scheme} grows from w h ="] = f"{min(grows):.2f} (predicted {limit:.2f})"
    return found


def _range(values: Iterable[float]) -> str:
    known = [value for value in values if not math.isnan(value)]
    return f"{min(known):.2g} to {max(known):.2g}" if known else "none"


def _of_balance(outcomes: dict[str, list[Outcome]]) -> dict[str, str]:
    found = {}
    for scheme in BALANCED:
        for name, some in outcomes.items():
            mine = [one for one in some if one.scheme == scheme]
            worst = max(mine, key=lambda one: abs(one.change))
            slow = min((one.step for one in mine if one.helped), default=math.inf)
            found[f"{scheme}, {name} map, steps of 0.01 to 100 contact times:"] = (
                f"worst energy residual {abs(worst.change):.1e}, "
                f"up to {max(one.contacts for one in mine)} contacts; "
                f"Newton's method needs help from {slow:.2g} contact times on, "
                f"{max(one.evaluations for one in mine)} evaluations at most"
            )
    return found


def _of_thesis(thesis: list[tuple[float, float, float, float]]) -> dict[str, str]:
    energy, momentum = [row[2] for row in thesis], [row[3] for row in thesis]
    lengths = [row[1] for row in thesis]
    return {
        "thesis2008, one contact, steps of 0.01 to 3 contact times:": (
            f"energy residual {_range(energy)}, momentum residual {_range(momentum)}, "
            f"contact {_range(lengths)} contact times long"
        )
    }


def main(
    folder: OutDirOption = None, quick: QuickOption = False, before: BeforeOption = None
) -> None:
    """Find where each scheme blows up or loses its energy balance.

    Example: python -m benchmarks.stability --quick
    """
    with results_in(folder, "stability", "modal") as results:
        found, sentence = run(results, quick)
        if before:
            draw_stability(results.path("stability-before.png"), before, results.folder)
        for what, value in found.items():
            out.say(f"{what} {value}")
        results.conclude(sentence)


if __name__ == "__main__":
    start("benchmarks.stability")
