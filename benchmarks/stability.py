"""Where methods fail: blow up, lose the energy, or let the actuator feed energy without bound.

Limits of free and damped vibration (`stability_limits`), energy over stiffness, mass, plate speed
and loss factor (`stability_maps`), and the closed loop over gain and latency (`stability_loop`).
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import astuple, fields

from benchmarks.program import OutDirOption, QuickOption, progress, start
from benchmarks.results import Results, results_in
from benchmarks.stability_limits import DAMPED, LIMITS, TEXTBOOK, damped_limits, growth
from benchmarks.stability_loop import LoopPoint, loop_map
from benchmarks.stability_maps import (
    BLOWN,
    WRONG,
    Map,
    Outcome,
    Predicted,
    border,
    contact_drift,
    loss_map,
    mass_map,
    shaken_map,
    stiffness_map,
    thesis_contact,
)
from benchmarks.stability_pictures import BALANCED, draw_energy, draw_limits
from hertzloop.cli.terminal import out

_MAPS: dict[str, Callable[[int], Map]] = {
    "stiffness": stiffness_map,
    "mass": mass_map,
    "shaken": shaken_map,
}
_NEWTON = 14  # evaluations of a contact solve; with more, bisection had to step in
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
    with progress("stability", 8) as advance:
        free, damped = list(growth(every)), list(damped_limits(every))
        advance(1)
        contact = contact_drift(every)
        advance(2)
        thesis = list(thesis_contact(every))
        advance(3)
        by_map: dict[str, Map] = {}
        for done, (name, measure) in enumerate(_MAPS.items(), 4):
            by_map[name] = measure(every)
            advance(done)
        outcomes = {name: found for name, (_, found) in by_map.items()}
        outcomes["loss"] = loss_map(every)
        advance(7)
        loop = list(loop_map(every=every))
    results.write_rows("stability-growth", ("scheme", "omega_h", "growth_per_step"), free)
    limits = ("scheme", "loss_factor", "predicted_omega_h", "measured_omega_h")
    results.write_rows("stability-damped", limits, damped)
    results.write("stability-contact", contact)
    columns = ("step", "contact_length", "energy_residual", "momentum_residual")
    results.write_rows("stability-thesis2008", columns, thesis)
    for name, found in outcomes.items():
        results.write(f"stability-{name}", found)
    results.write_rows(
        "stability-predicted",
        ["map", *(field.name for field in fields(Predicted))],
        ((name, *astuple(one)) for name, (predicted, _) in by_map.items() for one in predicted),
    )
    results.write("stability-loop", loop)
    draw_limits(results.path("stability.png"), free, damped, contact, thesis, by_map)
    draw_energy(results.path("stability-energy.png"), outcomes, loop)
    metrics = (
        _of_limits(free, damped)
        | _of_maps(by_map)
        | _of_balance(outcomes)
        | _of_thesis(thesis)
        | _of_loop(loop)
    )
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


def _of_limits(
    free: Iterable[tuple[str, float, float]], damped: list[tuple[str, float, float, float]]
) -> dict[str, str]:
    found = {}
    for scheme, limit in LIMITS.items():
        grows = [phase for name, phase, factor in free if name == scheme and factor > 1.0 + 1e-9]
        found[f"{scheme} grows from w h ="] = f"{min(grows):.2f} (predicted {limit:.2f})"
    for scheme in DAMPED:
        mine = [row for row in damped if row[0] == scheme]
        low, high = min(row[3] for row in mine), max(row[3] for row in mine)
        off = max(abs(row[3] - row[2]) for row in mine)
        found[f"{scheme}: limit of w h, loss factor 0 to 1"] = (
            f"{low:.2f} to {high:.2f} (off the predicted by {off:.0e})"
        )
    return found


def _range(values: Iterable[float]) -> str:
    known = [value for value in values if not math.isnan(value)]
    return f"{min(known):.2g} to {max(known):.2g}" if known else "none"


def _of_maps(by_map: dict[str, Map]) -> dict[str, str]:
    """How the textbook integrators' borders lie on the maps, steps over contact time."""
    found = {}
    for name, (predicted, outcomes) in by_map.items():
        for scheme in TEXTBOOK:
            wrong = border(outcomes, scheme, WRONG)
            doubled = border(outcomes, scheme, BLOWN)
            text = f"1 % wrong from {_range(b for _, b in wrong)} contact times"
            text += f", doubled from {_range(b for _, b in doubled)}"
            if scheme in LIMITS:
                ratios = [
                    b / getattr(one, scheme) for (_, b), one in zip(doubled, predicted, strict=True)
                ]
                text += f" ({_range(ratios)} of the predicted limit)"
            found[f"{name} map: {scheme}"] = text
    return found


def _of_balance(outcomes: dict[str, list[Outcome]]) -> dict[str, str]:
    found = {}
    for scheme in BALANCED:
        for name, some in outcomes.items():
            mine = [one for one in some if one.scheme == scheme]
            worst = max(mine, key=lambda one: abs(one.change))
            slow = min((one.step for one in mine if one.evaluations > _NEWTON), default=math.inf)
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


def _of_loop(loop: list[LoopPoint]) -> dict[str, str]:
    most = max(loop, key=lambda p: p.injected)
    better = [p for p in loop if p.plate_energy_db < -0.1]
    own = [p for p in loop if p.injected > 1.0]
    return {
        "most energy fed in by the actuator, of the impact's": (
            f"{most.injected:.2f} at kappa {most.kappa:g}, latency {most.latency_us:g} us"
        ),
        "the actuator feeds in more than the impact brought from kappa =": (
            f"{min(p.kappa for p in own):g}" if own else "none of those tried"
        ),
        "settings that take 0.1 dB or more off the plate": f"{len(better)} of {len(loop)}",
    }


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Find where each scheme and the closed loop blow up or lose their energy balance.

    Example: python -m benchmarks.stability --quick
    """
    with results_in(folder, "stability", "modal") as results:
        found, sentence = run(results, quick)
        for what, value in found.items():
            out.say(f"{what} {value}")
        results.conclude(sentence)


if __name__ == "__main__":
    start("benchmarks.stability")
