"""Scene, law and signal path of a run in words: labels of pictures, replays and reports."""

from typing import Any

from hertzloop.recordings.recording import Recording
from hertzloop.recordings.writer import RecordingError
from hertzloop.results.recorded import law_of
from hertzloop.scene.fields import unit_of
from hertzloop.scene.loading import shipped
from hertzloop.scene.materials import material_name
from hertzloop.scene.setup import Setup, load
from hertzloop.views.details import law_line, law_words

_NOT_NAMED = ("name", "shows", "plate.modes.content")  # the content has a digest of its own
_LONGEST = 40  # characters of a value


def keys_of(setup: Setup) -> dict[str, Any]:
    """Return all keys that decide what is simulated, as "table.key": value."""
    found: dict[str, Any] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                walk(f"{prefix}.{key}" if prefix else key, inner)
        elif prefix not in _NOT_NAMED:
            found[prefix] = value

    walk("", setup.scene.model_dump(exclude_none=True))
    return found


def differences(a: Setup, b: Setup) -> list[tuple[str, Any, Any]]:
    """Return keys with different values, as key, value in `a`, value in `b`; None: no such key."""
    left, right = keys_of(a), keys_of(b)
    return [
        (key, left.get(key), right.get(key))
        for key in dict.fromkeys([*left, *right])
        if left.get(key) != right.get(key)
    ]


def closest_shipped(setup: Setup) -> tuple[str, list[tuple[str, Any, Any]]]:
    """Return the shipped scene that differs least from a scene, and the differences."""
    known = [(name, differences(setup, load(name))) for name in shipped()]
    return min(known, key=lambda found: (found[0] != setup.scene.name, len(found[1])))


def bodies(setup: Setup) -> str:
    """Return sphere and structure in words, for example "R = 3 mm, steel, on 3 mm aluminium"."""
    sphere, structure = setup.mechanics.sphere, setup.mechanics.structure
    of_sphere, of_plate = (
        material_name(table.material).replace("_", " ") or "own material"
        for table in (setup.scene.sphere, setup.scene.plate)
    )
    ball = f"R = {1e3 * sphere.radius_m:g} mm, {of_sphere}"
    if structure.mode_table is not None:
        return f"{ball}, on a structure from a file of modes"
    if structure.local_plate is None:
        return f"{ball}, on {structure}"
    return f"{ball}, on {1e3 * structure.local_plate.thickness_m:g} mm {of_plate}"


def control(setup: Setup) -> str:
    """Return law, parameters, latency and converters: "slope_threshold, kappa 0.8, ..."."""
    table = setup.scene.controller
    if not setup.scene.controller.has_law:
        return "no control"
    pieces = [table.law]
    for key, value in table.model_dump(exclude_none=True).items():
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and key not in type(table).model_fields:
            name_without_unit, unit = unit_of(key)
            pieces.append(f"{name_without_unit} {value:g} {unit}".strip())
    pieces.append(f"latency {table.latency_us:g} us")
    if table.jitter_us:
        pieces.append(f"jitter {table.jitter_us:g} us")
    if table.clock_ppm or table.clock_phase:
        pieces.append(f"clock {table.clock_ppm:+g} ppm, phase {table.clock_phase:g}")
    if table.drop_out_probability:
        pieces.append(f"{100 * table.drop_out_probability:g} % of commands lost")
    pieces.append(_bits("sensor", setup.scene.sensors.bits))
    if table.bits != "ideal":
        pieces.append(_bits("actuator", table.bits))
    if setup.sensor.every_steps > 1:
        period = setup.sensor.every_steps * setup.run.step_ns / 1000
        pieces.append(f"a sample every {period:g} us")
    return ", ".join(pieces)


def _bits(where: str, bits: int | str) -> str:
    return f"ideal {where}" if bits == "ideal" else f"{where} {bits} bit"


def description(setup: Setup, recording: Recording) -> list[str]:
    """Describe a run in lines of Markdown."""
    name, changed = closest_shipped(setup)
    given = setup.mechanics.sphere.given_speed_m_s
    hit = (
        f"drop {1e3 * setup.mechanics.sphere.drop_height_m:g} mm"
        if given is None
        else f"{given:g} m/s"
    )
    lines = [f"{bodies(setup)}, {hit}", control(setup)]
    law = law_of(recording)
    if law.law and law.law != setup.scene.controller.law:
        lines.append(f"Law that ran: {law_line(law)}")
    if changed:
        listed = [f"{key} = {_value(own)} ({_value(theirs)})" for key, own, theirs in changed[:8]]
        more = f" and {len(changed) - 8} more" if len(changed) > 8 else ""
        lines.append(f"Differs from the shipped {name} (in brackets): {', '.join(listed)}{more}")
    else:
        lines.append(f"As the shipped scene {name}")
    return lines


def compared(a: Setup, b: Setup) -> list[str]:
    """Describe how two scenes differ, in lines of Markdown."""
    found = differences(a, b)
    if not found:
        return ["A and B are the same scene."]
    listed = [f"{key} A {_value(own)}, B {_value(theirs)}" for key, own, theirs in found[:10]]
    more = f" and {len(found) - 10} more" if len(found) > 10 else ""
    return [f"A and B differ in: {'; '.join(listed)}{more}"]


def _value(value: Any) -> str:
    if value is None:
        return "not there"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def text_of_law(recording: Recording) -> str:
    """Return the text of the law that ran.

    Raises:
        RecordingError: The recording does not hold it.
    """
    law = law_of(recording)
    if not recording.law_source:
        raise RecordingError(
            f"the recording holds no text of its law, {law_line(law)}: a compiled law has none"
        )
    if law.law and not law.as_announced:
        raise RecordingError(
            f"the recording holds no text of the law that ran, {law_words(law.law, None)}: its "
            "controller is another program. The law of the scene did not run: "
            f"{law_words(law.scene_law, None)}"
        )
    return recording.law_source
