"""Sentences and tables on the effects that a run neglects."""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Console

from hertzloop.analysis.validity import OF_PLATE, Effect, EffectState, Facts, Finding, Neglected
from hertzloop.views.format import Table, percent, pressure, styled


def _yields(f: Facts, x: float) -> str:
    if f.weaker is None or math.isnan(x):
        return "when the plate yields is not known: give plate.material.yield_pa or hardness_pa"
    body, strength = f.weaker
    words = (
        f"the {body} yields: mean pressure {pressure(f.mean_pressure_pa)}, "
        f"{pressure(1.5 * f.mean_pressure_pa)} in the centre, where yield begins at "
        f"{pressure(strength.first_yield_pa)}"
    )
    if f.mean_pressure_pa > strength.pressure_pa:
        words += f" and is full at a mean of {pressure(strength.pressure_pa)}"
    return f"{words}; contact.plasticity = 'thornton' models it"


def _kirchhoff(f: Facts, x: float) -> str:
    return (
        f"the waves are short against the plate thickness, k h = {f.kh:.2g} at 1/T: Kirchhoff's "
        f"plate may take {percent(x)} less energy than an elastic solid, and the rebound be off by "
        f"{percent(f.kirchhoff.rebound_speed)} of the impact speed (requested: "
        f"{percent(f.accuracy)}); plate.theory = '3d' models it"
    )


def _static(f: Facts, x: float) -> str:
    return (
        "near the force an elastic solid deforms differently from Kirchhoff's plate with Hertz's "
        f"half space: peak force and contact time may be off by {percent(x)} (requested: "
        f"{percent(f.accuracy)})"
    )


def _delay(f: Facts, x: float) -> str:
    actuator = "" if f.has_bandwidth else "; the actuator has no delay here"
    return (
        f"the delay from sample to force is {1e6 * f.delay_s:.3g} us, {percent(x)} of the contact: "
        f"most laws tolerate about a tenth{actuator}"
    )


_WORDS: dict[Effect, Callable[[Facts, float], str]] = {
    Effect.YIELD: _yields,
    Effect.WIDE_ON_SPHERE: lambda f, x: (
        f"the contact is {x:.2g} of the sphere's radius wide: Hertz's law, a parabola on a flat, "
        f"is off by about {percent(x * x)}"
    ),
    Effect.WIDE_ON_PLATE: lambda f, x: (
        f"the plate is too thin for Hertz's law, which assumes a half space: the contact radius is "
        f"{x:.2g} of the thickness"
    ),
    Effect.THEORY_ENERGY: _kirchhoff,
    Effect.THEORY_PEAK: _static,
    Effect.LARGE_DEFLECTION: lambda f, x: (
        f"the plate deflects by {1e3 * f.run.deflection_m:.2g} mm, {x:.2g} of its thickness: a "
        f"real one is stiffer, by up to {percent(x * x)} where its edges are held in the plane"
    ),
    Effect.SPHERE_VIBRATION: lambda f, x: (
        f"the contact lasts {x:.2g} periods of the sphere's lowest vibration, which a rigid mass "
        "behind Hertz's spring does not have"
    ),
    Effect.THICKNESS_RESONANCE: lambda f, x: (
        f"the plate is too thick for thin-plate theory: the contact lasts {x:.2g} periods of the "
        "first resonance through the thickness"
    ),
    Effect.REFLECTIONS: lambda f, x: (
        f"bending waves are back from the edge after {1e6 * f.first_return_s:.3g} us, the run goes "
        f"on for {1e6 * f.after_touch_s:.3g} us, and an infinite plate has no edge"
    ),
    Effect.LOOP_DELAY: _delay,
    Effect.ACTUATOR_FORCE: lambda f, x: (
        "the actuator has no force limit here; the law uses "
        f"{f.run.actuator_n:.3g} N" if math.isnan(x) else
        f"the actuator reaches its largest force, {f.run.actuator_n:.3g} N: the law may want more"
    ),
    Effect.ACTUATOR_MASS: lambda f, x: (
        "no mass of the actuator moves with the plate here; from "
        f"{1e3 * f.mass_that_matters_kg:.2g} g on it would matter (actuator.mass_kg)" if f.local
        else "no mass of the actuator moves with the structure here (actuator.mass_kg)"
    ),
    Effect.AIR_ON_MODES: lambda f, x: (
        "how much air damps the modes is computed for thin plates only" if math.isnan(x) else
        f"air damps the modes above coincidence {x:.2g} times as much as the plate itself does: "
        "waves that return after milliseconds are weaker than computed; plate.radiation models it"
    ),
    Effect.AIR_FILM: lambda f, x: (
        f"the film of air below the sphere takes {percent(x)} of its energy"
    ),
    Effect.DRAG: lambda f, x: f"drag takes {percent(x)} of the energy of the fall",
    Effect.SENSOR_RANGE: lambda f, x: (
        f"the law looks {1e6 * f.flight_m:.3g} um above the plate, {x:.2g} times as far as the "
        "sensor's range goes (sensors.full_scale)"
    ),
    Effect.DAMPER_BEHIND_SPRING: lambda f, x: (
        "the contact damper ignores the deflection rate of the truncated modes: "
        f"plate energy may be off by {percent(x)} (requested: {percent(f.accuracy)})"
    ),
    Effect.REFOCUSING: lambda f, x: (
        f"every {1e3 * f.revival_s:.3g} ms all modes of this square plate come back in phase, "
        "unlike those of a real plate: use the largest plate speed per contact, not per run"
    ),
}  # fmt: skip
# What of the scene puts an effect into the model.
_PARTS: dict[Effect, Callable[[Facts], str]] = {
    Effect.YIELD: lambda f: f"contact.plasticity = '{f.plasticity}'",
    Effect.THEORY_ENERGY: lambda f: "plate.theory",
    Effect.THEORY_PEAK: lambda f: "plate.theory",
    Effect.THICKNESS_RESONANCE: lambda f: "plate.theory",
    Effect.REFLECTIONS: lambda f: "reflections, as far as they are asked for",
    Effect.ACTUATOR_MASS: lambda f: "actuator.mass_kg",
    Effect.AIR_ON_MODES: lambda f: "plate.radiation",
    Effect.DAMPER_BEHIND_SPRING: lambda f: "plate.tail, a damped mode",
}


def _sentence(facts: Facts, found: Finding) -> str:
    if found.state is EffectState.IN_THE_MODEL:
        return f"in the model: {_PARTS[found.effect](facts)}"
    return _WORDS[found.effect](facts, found.value)


def not_evaluated(neglected: Neglected) -> str:
    """Return which effects have no size in this structure, in a sentence; empty if all have one."""
    if neglected.facts is None or neglected.facts.local is not None:
        return ""
    return (
        f"Not evaluated: {', '.join(OF_PLATE)}. No plate at the contact point is known for "
        f"{neglected.facts.spec.plate}; for a file of modes, plate.thickness_m gives one."
    )


def effects_as_json(neglected: Neglected) -> dict[str, Any]:
    """`validity`: all indicators, fields as in `Finding`, each with its name and a sentence with
    the size; `warnings`: sentences on those that are out of range by far."""
    shown: list[dict[str, Any]] = []
    for found in neglected.findings:
        assert neglected.facts is not None
        fields = asdict(found)
        name = fields.pop("effect")
        shown.append({"name": name, **fields, "sentence": _sentence(neglected.facts, found)})
    beyond = [one for one in shown if one["state"] == EffectState.OUT_OF_RANGE]
    return {"validity": shown, "warnings": [f"{one['name']}: {one['sentence']}" for one in beyond]}


_HEADS = {
    EffectState.OUT_OF_RANGE: ("OUT OF RANGE:", "bold red"),
    EffectState.LEFT_OUT: ("Neglected:", "yellow"),
}
_STATE_WORDS = {EffectState.LEFT_OUT: "neglected", EffectState.NOT_KNOWN: "unknown"}
# The quantity that the value of an indicator is, for the one line that a run prints.
_BRIEF: dict[str, tuple[str, str]] = {
    Effect.YIELD: ("peak contact pressure is {x:.2g} times first yield", "contact.plasticity"),
    Effect.WIDE_ON_SPHERE: ("contact radius is {x:.2g} of the sphere radius", ""),
    Effect.WIDE_ON_PLATE: ("contact radius is {x:.2g} of the plate thickness", ""),
    Effect.THEORY_ENERGY: ("energy error of thin-plate theory is {p}", "plate.theory"),
    Effect.THEORY_PEAK: ("peak-force error of thin-plate theory is {p}", "plate.theory"),
    Effect.LARGE_DEFLECTION: ("deflection is {x:.2g} of the plate thickness", ""),
    Effect.SPHERE_VIBRATION: ("contact lasts {x:.2g} vibration periods of the sphere", ""),
    Effect.THICKNESS_RESONANCE: ("contact lasts {x:.2g} periods through the thickness", ""),
    Effect.REFLECTIONS: ("run lasts {x:.2g} times the wave return time", "run.plate_model"),
    Effect.LOOP_DELAY: ("loop delay is {p} of the contact time", ""),
    Effect.AIR_ON_MODES: ("air damping is {x:.2g} times plate damping", "plate.radiation"),
    Effect.AIR_FILM: ("air film takes {p} of the energy", ""),
    Effect.DRAG: ("drag takes {p} of the fall energy", ""),
    Effect.SENSOR_RANGE: ("law needs {x:.2g} times the sensor range", "sensors.full_scale"),
    Effect.DAMPER_BEHIND_SPRING: ("energy error of contact damping is {p}", ""),
    Effect.REFOCUSING: ("the modes of a square plate return in phase during the run", ""),
}


def sentences_of(found: Iterable[dict[str, Any]]) -> list[tuple[str, str]]:
    """Heads and sentences on effects out of range, then on neglected effects."""
    return [(head, sentence) for head, _, sentence in _styled_sentences(found)]


def _styled_sentences(found: Iterable[dict[str, Any]]) -> list[tuple[str, str, str]]:
    known = list(found)
    return [
        (*_HEADS[state], f"{f['sentence']}.")
        for state in _HEADS for f in known if f["state"] == state
    ]  # fmt: skip


def brief_warnings(found: Iterable[dict[str, Any]]) -> list[tuple[str, str, str]]:
    """Render each effect outside its limit on one line of at most 80 columns.

    Args:
        found: The indicators, as `effects_as_json` writes them.

    Returns:
        Head, style and text of each line: effects out of range first, then neglected ones.
    """
    known = list(found)
    lines = []
    for state, (head, style) in _HEADS.items():
        for one in known:
            if one["state"] != state:
                continue
            text, key = _BRIEF.get(one["name"], (one["name"], ""))
            if math.isnan(one["value"]):
                text = one["name"]
            words = text.format(x=one["value"], p=percent(one["value"]))
            lines.append((head, style, f"{words} ({key})." if key else f"{words}."))
    return lines


def show_neglected(console: Console, found: Iterable[dict[str, Any]]) -> None:
    """Print a sentence on each neglected effect."""
    for head, style, sentence in _styled_sentences(found):
        console.print(styled((head, style), f" {sentence}"), soft_wrap=True)


def table_of(found: Iterable[dict[str, Any]]) -> Table:
    """All indicators with their thresholds."""
    table = Table(title="Neglected effects")
    for heading in ("effect", "formula", "value", "threshold", ""):
        table.add_column(heading, justify="right" if heading in ("value", "threshold") else "left")
    for finding in found:
        value = finding["value"]
        falls = finding["beyond"] < finding["threshold"]
        _, style = _HEADS.get(finding["state"], ("", ""))
        table.add_row(
            finding["name"], finding["formula"], "" if math.isnan(value) else f"{value:.2g}",
            f"{'>' if falls else '<'} {finding['threshold']:.2g}",
            styled((_STATE_WORDS.get(finding["state"], finding["state"]), style)),
        )  # fmt: skip
    return table
