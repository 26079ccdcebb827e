"""The part of a run that a study evaluates, and the simulation of as much as it needs."""

import math
from typing import Annotated, Literal

from pydantic import Field

from hertzloop.loop.impact_end import quiet_steps
from hertzloop.loop.simulate import SimulatedRun, simulate
from hertzloop.scene.setup import Setup

Span = Literal["impact", "run"]
SpanOption = Annotated[Span, Field(description="Evaluate the first impact or the whole run.")]
# The other span, and both in words.
OTHER: dict[Span, Span] = {"impact": "run", "run": "impact"}
IN_WORDS: dict[Span, str] = {"impact": "in the first impact", "run": "over all contacts"}
# After the lead-in, unless an impact is expected to last longer; four times as many until it is
# over. A run that is over ends before.
_FIRST_STEPS = 512
_SLOWER = 4.0  # than on a rigid plate: as long as most contacts last
_SOON = 2.0  # times the silence that ends an impact: until then most are over


def follow(setup: Setup, span: Span) -> tuple[Setup, SimulatedRun]:
    """Simulate as much of a scene as the span asks for; the scene with the model of the plate
    that it came to.

    "auto" means the infinite plate where it meets the accuracy until the span is over.
    """
    if span == "run":
        setup = setup.with_plate_model(setup.plate_model)
        return setup, simulate(setup)
    if setup.scene.run.plate_model == "auto":
        found = _on_infinite_plate(setup)
        if found:
            return found
        setup = setup.with_plate_model("modal")
    return setup, _until_over(setup)


def _on_infinite_plate(setup: Setup) -> tuple[Setup, SimulatedRun] | None:
    """Simulate the first impact on an infinite plate, and its scene; None where that does not meet
    the accuracy until the impact is over."""
    run, touch_s, quiet = setup.run, setup.first_touch_s, quiet_steps(setup)
    # An impact lasts about as long as on a rigid plate, and the law's last force comes later.
    contact = round(setup.law_context.rigid_contact_s / run.step_s)
    least_s = run.step_s * (contact + setup.signal_path.latency_steps + quiet)
    plate = setup.infinite_plate
    if not plate.error(min(least_s, run.duration_s - touch_s)) <= run.accuracy:
        return None
    # Most impacts are over soon: how long the plate meets the accuracy after that is not asked.
    for most_s in (_SOON * quiet * run.step_s, math.inf):
        lasts_s = plate.lasts_s(most_s)
        steps = int((touch_s + lasts_s) / run.step_s)
        infinite = setup.with_plate_model("infinite")
        found = simulate(infinite, impact_only=True, steps=min(steps, run.steps))
        if found.over or steps >= run.steps:
            return infinite, found
        if lasts_s < most_s:
            break
    return None


def _until_over(setup: Setup) -> SimulatedRun:
    """Simulate until the first impact is over, the run's end at the latest."""
    first, lasts_s = _FIRST_STEPS, _SLOWER * setup.law_context.rigid_contact_s
    while first < lasts_s / setup.run.step_s + setup.signal_path.latency_steps + quiet_steps(setup):
        first *= 4
    steps = round(setup.run.lead_in_s / setup.run.step_s) + first
    while steps < setup.run.steps:
        found = simulate(setup, impact_only=True, steps=steps)
        if found.over:
            return found
        steps *= 4
    return simulate(setup, impact_only=True)
