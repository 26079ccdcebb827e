"""Sentences and tables that the command `budget` prints."""

from collections.abc import Sequence

from hertzloop.cli.terminal import out
from hertzloop.common import readable
from hertzloop.studies.budget.limits import LEAST, Boundary
from hertzloop.studies.budget.probability import Probability
from hertzloop.studies.budget.result import BudgetResult, InPlant
from hertzloop.studies.budget.stability import instability
from hertzloop.studies.margin.sentences import margin_lines
from hertzloop.views.format import Table
from hertzloop.views.verdict import spans_differ


def _plants(found: BudgetResult) -> list[tuple[str, InPlant]]:
    """Return the plants that were searched, by what sentences call them."""
    real = [("the real plant", found.real)] if found.real else []
    if not found.other:
        return [("the scene", found.ideal), *real]
    return [("the first impact", found.ideal), ("the whole run", found.other), *real]


def effect_lines(found: BudgetResult) -> list[str]:
    """Return sentences on the goal, and on what the law does in each plant."""
    lines = [verdict_line(found)]
    for name, plant in _plants(found):
        energy = plant.nominal.over_phases["plate_energy_db"]
        words = "meets the goal" if plant.nominal.met else "misses the goal"
        if plant.nominal.unstable:
            words += "; the loop is unstable"
        elif plant.unstable:
            words += f"{', but' if plant.nominal.met else ';'} {instability(plant.margin)}"
        lines.append(f"In {name} the law {words}: plate energy {energy} dB over touch phases.")
        if plant is found.ideal:
            own = plant.nominal.metrics["plate_energy_db"]
            hint = "" if found.other else "--span both searches the limits of each."
            lines += spans_differ(own, found.other_db, found.span, hint)
            if found.other_db is None:
                lines.append("Later impacts are not predictable.")
        lines += noise_lines(name, plant)
        if plant.left_out:
            refused = ", ".join(plant.left_out)
            lines.append(f"The real plant is without {refused}, which the scene refuses.")
    return lines


def verdict_line(found: BudgetResult) -> str:
    """Return in one sentence whether the law meets its goal, and what limits it first."""
    goal = " and ".join(map(str, found.goals))
    plants = _plants(found)
    met = [name for name, plant in plants if plant.nominal.met and not plant.unstable]
    missed = [name for name, _ in plants if name not in met]
    words = f"meets its goal {goal} at every touch phase in {' and in '.join(met)}"
    if missed and met:
        words += f", but not in {' and in '.join(missed)}"
    if not met:
        words = f"misses its goal {goal} in {' and in '.join(missed)}"
    first = found.ideal.binds_first
    limits = {limit.quantity: limit.words() for limit in found.ideal.limits}
    binding = "" if first is None else f"; {first} binds first: {limits[first]}"
    return f"{found.scene}: the law {found.law} {words}{binding}."


def noise_lines(name: str, plant: InPlant) -> list[str]:
    """Return a sentence where a law tolerates noise as large as the penetration that it senses."""
    deepest_m = plant.deepest_m
    noise = next((limit for limit in plant.limits if limit.quantity == "noise"), None)
    if deepest_m is None or noise is None or noise.value is None or noise.value < deepest_m:
        return []
    return [
        f"In {name} the tolerated noise, {noise.words()}, is as large as the penetration itself "
        f"({readable.quantity(deepest_m, 'm')} without control): the law meets its goal there "
        "without seeing the contact, so this is no demand on a sensor."
    ]


def wider_lines(found: BudgetResult) -> list[str]:
    """Return a sentence on the quantities of which the real plant tolerates more than the scene."""
    if found.real is None:
        return []
    wider = [
        f"{real.quantity} ({real.words()} against {ideal.words()})"
        for ideal, real in zip(found.ideal.limits, found.real.limits, strict=True)
        if ideal.value is not None
        and real.value is not None
        and (real.value < ideal.value if ideal.quantity in LEAST else real.value > ideal.value)
    ]
    if not wider:
        return []
    return [
        f"The real plant tolerates more of {', '.join(wider)}: its contact is another one, so its "
        "limits need not lie within those of the scene."
    ]


def print_budget(found: BudgetResult) -> None:
    """Print a budget on one screen."""
    for line in effect_lines(found):
        out.say(line)
    plants = _plants(found)
    out.print(_limits_table(plants))
    for name, plant in plants:
        _print_limits(name, plant)
    for line in wider_lines(found):
        out.say(line)
    margin = found.ideal.margin
    if margin is None:
        out.print("Linear margin: none, because the loop in flight is not linear under this law.")
    else:
        for line in margin_lines(margin):
            out.say(line)


def _print_limits(name: str, plant: InPlant) -> None:
    """Print which limit of a plant binds first, and what is special about the others."""
    unstable = [one.quantity for one in plant.limits if one.boundary is Boundary.UNSTABLE]
    if unstable:
        out.say(
            f"In {name} no value of {', '.join(unstable)} is tolerated, because the linear "
            "loop is unstable."
        )
    if plant.binds_first is not None:
        out.print(f"In {name} {plant.binds_first} binds first.")
    elif not unstable:
        out.print(f"In {name} no quantity has a limit.")
    for limit in plant.limits:
        if not limit.interval:
            values = ", ".join(f"{x:.4g}" for x in limit.holds_again[:6])
            out.say(
                f"In {name} the goal is met again at {limit.quantity} = {values}: "
                "the tolerated values are not an interval."
            )
        if limit.reason:
            fails_at = ""
            if limit.first_failure is not None:
                fails_at = readable.quantity(limit.first_failure, limit.unit, 4)
            head = _REASONS[limit.boundary].format(limit, fails_at)
            out.say(f"In {name} {head} {limit.reason}")


def trace_line(latencies_us: Sequence[float]) -> str:
    """Summarise a trace of latencies, us, in a sentence."""
    ordered = sorted(latencies_us)
    median, high = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
    return (
        f"Trace of {len(ordered)} latencies: median {median:g} us, 99 % below {high:g} us, largest "
        f"{ordered[-1]:g} us."
    )


_REASONS = {
    "no limit": "{0.quantity} has no limit:",
    "refused": "the next value of {0.quantity} is refused:",
    "failed": "{0.quantity} at {1} makes a case fail:",
    "not possible": "{0.quantity} cannot be varied.",
}


def _limits_table(plants: list[tuple[str, InPlant]]) -> Table:
    """Return the tolerated values of each quantity, a column for each plant."""
    columns: list[tuple[str, list[str]]] = []
    for name, plant in plants:
        columns.append((name, [limit.words() for limit in plant.limits]))
        if any(limit.impact_alone for limit in plant.limits):
            alone = [(limit.impact_alone or limit).words() for limit in plant.limits]
            columns.append((f"{plant.span} alone", alone))
    first = plants[0][1].limits
    low_high = (
        " to ".join(readable.quantity(end, one.unit) for end in one.searched) for one in first
    )
    columns.append(("searched", list(low_high)))
    title = "Tolerated, each with the other quantities as in the plant"
    table = Table("quantity", right=[heading for heading, _ in columns], title=title)
    for one, *cells in zip(first, *(cells for _, cells in columns), strict=True):
        table.add_row(one.quantity, *cells)
    return table


def print_probability(likely: Probability, worst: str) -> None:
    """Print how likely the goals are met."""
    out.say(probability_line(likely))
    names = ("plate_energy_db", "rebound_percent", "radiated_db", "peak_force_n")
    right = [f"{100 * quantile:g} %" for quantile in likely.quantiles[names[0]]]
    table = Table("metric", right=right, title="Quantiles over the uncertain cases")
    for name in names:
        table.add_row(name, *(f"{x:.4g}" for x in likely.quantiles[name].values()))
    out.print(table)
    out.say(f"Run the worst case again: {worst}")


def probability_line(likely: Probability) -> str:
    """Return how likely the goals are met, in a sentence."""
    low, high = likely.interval
    return (
        f"Probability that the goal is met: {likely.value:z.3f} ({low:z.3f} to {high:z.3f} at "
        f"{100 * likely.confidence:g} %, {likely.cases} cases, {likely.unstable} unstable)."
    )
