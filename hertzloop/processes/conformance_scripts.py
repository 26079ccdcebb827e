"""What the plant of `hertzloop conformance` says: scripts of made-up samples, or a recording's."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hertzloop.loop.controller_node import physical_values
from hertzloop.setup import Setup, load, parse
from recordings.reader import Recording

_SCENE = "aluminium-3mm"
_SPEED_M_S = 1.0
_LOWEST_M = -9e-6  # of the deepest contact; the converter's range is stretched to what it needs
_LONG_STEPS = 20_000  # beyond which an exchange a step would take minutes


@dataclass(frozen=True)
class Script:
    """A run as the plant plays it, whatever forces come.

    `samples` are codes of a converter or values, with a flag each in `clipped`; `ending` is
    "whole", "fault" (the plant gives up half way and says so) or "death" (it leaves half way).
    `late_end`: the plant's end comes after the recorder has confirmed its completion and left, as
    it may, since the two are on different links.
    `expected`: the force of every step (N), where `expected_of` says whose.
    """

    name: str
    setup: Setup
    samples: np.ndarray
    clipped: np.ndarray
    scale: float = 0.0
    offset: float = 0.0
    stiffness: float = 0.0
    ending: str = "whole"
    late_recorder: bool = False
    late_end: bool = False
    horizons: tuple[int | None, ...] = (1, None)
    expected: np.ndarray | None = None
    expected_of: str = ""

    @property
    def lead_steps(self) -> int:
        """The force of a sample at step k acts from step k + lead_steps on."""
        return 1 + self.setup.line.latency_steps

    def values(self) -> np.ndarray:
        """The samples in the unit of their quantity."""
        codes = self.samples.dtype.kind == "i"
        return physical_values(self.samples, self.scale, self.offset) if codes else self.samples


def gap_m(steps: int, contacts: Sequence[tuple[int, int]]) -> np.ndarray:
    """A gap in free flight (m) with half sines of contact, (first step, length) each.

    No value is zero exactly, nor are two the same: laws that differ in the last bit show it.
    """
    at = np.arange(steps)
    away = [np.where(at < one, one - at, at - one - length + 1) for one, length in contacts]
    gap = np.min(away, axis=0) * 1e-6 * _SPEED_M_S
    for first, length in contacts:
        phase = np.pi * (np.arange(length) + 0.5) / length
        gap[first : first + length] = _LOWEST_M * (length / 29.0) * np.sin(phase)
    return gap * (1.0 + 1e-7 * np.cos(at))


def _script(
    name: str, steps: int, contacts: Sequence[tuple[int, int]], settings: Sequence[str]
) -> Script:
    """A script from a gap; raises SceneError for a law or setting that cannot be."""
    duration = f"run.duration_s={steps * 1e-6:.9f}"
    fixed = (duration, "run.lead_in_s=0", "run.accuracy=0.1", "run.plate_model=modal")
    setup = load(_SCENE, [*settings, *fixed]).renamed(f"conformance-{name}")
    values = gap_m(steps, contacts)[:: setup.every_steps]
    model = setup.start_sensor().model
    flags = np.zeros(len(values), np.uint8)
    script = Script(
        name, setup, values, flags, model.scale, model.offset,
        setup.plant.contact.stiffness,
    )  # fmt: skip
    if model.ideal:
        return script
    # Stretched so that the deepest contact, or the largest force, leaves the converter's range.
    values *= 1.3 * (model.low if model.low < 0.0 else model.high) / values.min()
    flags[:] = (values < model.low) | (values > model.high)
    values = np.clip(values, model.low, model.high)
    codes = np.floor((values - model.offset) / model.scale + 0.5).astype(np.int64)
    return replace(script, samples=np.clip(codes, model.first_code, model.last_code))


def scripts(law: str | None = None, settings: Sequence[str] = ()) -> list[Script]:
    """All scripts, in the order in which they are played, `settings` applied to their scenes;
    with a law its forces are expected.

    Raises SceneError for a law or setting that is none.
    """
    bouncing = [(40, 29), (130, 17), (190, 9), (203, 5)]
    asked = (*settings, *([f"controller.law={law}"] if law else []))
    made = [
        _script("touch", 160, bouncing[:1], asked),
        _script("bounce", 400, bouncing, ("controller.latency_us=5", *asked)),
        _script(
            "saturation", 300, bouncing, ("sensors.bits=8", "sensors.full_scale=contact", *asked)
        ),
        _script(
            "every-third",
            400,
            bouncing,
            ("sensors.every_steps=3", "controller.latency_us=4", *asked),
        ),
        replace(
            _script("late-recorder", 160, bouncing[:1], asked), late_recorder=True, horizons=(None,)
        ),
        replace(_script("late-end", 160, bouncing[:1], asked), late_end=True, horizons=(None,)),
        replace(_script("fault", 300, bouncing, asked), ending="fault", horizons=(None,)),
        replace(_script("death", 300, bouncing, asked), ending="death", horizons=(None,)),
    ]
    return [_with_law(script, law) for script in made] if law else made


def _with_law(script: Script, law: str) -> Script:
    """The script with the forces that our own law of this name answers to it."""
    answering = script.setup.start_controller()
    answering.process(script.values())
    return replace(script, expected=answering.forces.copy(), expected_of=f"law '{law}'")


def recorded(recording: Recording) -> Script:
    """The samples and forces of a recording. Raises ValueError if it is not whole, SceneError if
    its scene cannot be read."""
    if recording.problems:
        raise ValueError(f"{recording.path} is not whole: {recording.problems[0]}")
    setup, daq = parse(recording.scene_toml), recording.daq
    codes = daq.arrays.get("code")
    samples = daq.arrays["value"] if codes is None else codes.astype(np.int64)
    flags = daq.arrays.get("saturated", np.zeros(len(samples), np.uint8))
    told = recording.ends["controller"].set_up.stiffness  # not by controllers of older versions
    return Script(
        name=setup.name,
        setup=setup,
        samples=samples,
        clipped=flags,
        scale=daq.scale,
        offset=daq.offset,
        stiffness=told or setup.plant.contact.stiffness,
        horizons=(1, None) if setup.steps <= _LONG_STEPS else (None,),
        expected=recording.force.arrays["force_n"],
        expected_of=str(recording.path),
    )
