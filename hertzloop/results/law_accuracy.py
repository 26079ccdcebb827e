"""Whether a run keeps its accuracy under its law: the first impact again with twice the modes.

How many modes a plate needs is estimated from what they do to an impact. A law that waits for a
threshold may meet it so near to a sample that the modes left out decide at which: what it latches
then differs by a whole sample, and the impact by far more than the modes themselves would do.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

from hertzloop.loop.compiled import LawStopped, simulate
from hertzloop.results.cases import latched_us
from hertzloop.results.facts import percent
from hertzloop.results.verify import (
    Verification,
    changes,
    finer_spec,
    past_first_impact,
    started_as,
)
from hertzloop.setup import Setup
from plant.plant import PlantSpec
from plant.schemes.registry import SCHEMES

_FAR = 2.0  # times what is expected: twice the modes hardly change more where the law decides alike
_MOST_STEPS = 2_000_000  # that are simulated in memory
_FIGURES = {
    "penetration": "the penetration",
    "rebound_speed": "the rebound speed",
    "plate_energy": "the plate energy",
}


@dataclass(frozen=True)
class LawAccuracy:
    """What twice the modes change in the first impact, the loop closed; `asked` and `expected`
    error of the run, relative; delay that the law latches in the run and with twice the modes, us,
    nan of a law that latches none."""

    by_modes: Verification
    asked: float
    expected: float
    delay_us: float
    finer_delay_us: float

    @property
    def kept(self) -> bool:
        """Whether the changes are what the run expects."""
        return self.by_modes.largest <= _FAR * max(self.asked, self.expected)

    @property
    def sentence(self) -> str:
        """Which figure moves by how much, and why."""
        moved = {key: getattr(self.by_modes, key) for key in _FIGURES}
        key = max(moved, key=lambda name: moved[name])
        said = (
            "The accuracy asked for is not kept under the law: twice the modes, up to "
            f"{self.by_modes.frequency_limit_hz / 1e3:.4g} kHz, change {_FIGURES[key]} of the "
            f"first impact by {percent(moved[key])} (asked: {percent(self.asked)})"
        )
        if self.delay_us != self.finer_delay_us and self.delay_us + self.finer_delay_us > 0.0:
            said += (
                f", as the law then latches {self.finer_delay_us:g} us, not {self.delay_us:g} us: "
                "what it decides here hangs on less than the model's error"
            )
        return f"{said}."


def judged(setup: Setup, until_s: float) -> LawAccuracy | None:
    """Simulate the first impact of a scene, over with the push it causes by `until_s`, with its
    modes and with twice as many, as far as the step carries them.

    None without a law, where the step carries no more modes, where more are not known or take long
    to find (a file, edges that are not simply supported, an infinite plate, the published scheme),
    without an impact that ends by then, and where the law stops.
    """
    steps = min(round(until_s / setup.step_s) + 3, setup.steps)
    converges = SCHEMES[setup.scheme].converges
    if not setup.has_law or not converges or steps > _MOST_STEPS:
        return None
    # How long a run lasts may decide about the model of its plate.
    short = setup.on_plate(setup.plate_model).lasting(steps)
    finer = _twice_the_modes(short)
    if finer is None:
        return None
    try:
        run = simulate(short)
        until = past_first_impact(short, run.rows)
        if until is None:
            return None
        other = simulate(short.lasting(until), own_plant=started_as(short, finer))
    except LawStopped:
        return None
    found = changes(short, run.rows[:, :until], other.rows, finer)
    if found is None:
        return None
    return LawAccuracy(
        found, setup.accuracy, short.expected_error,
        latched_us(short, run), latched_us(short, other),
    )  # fmt: skip


def _twice_the_modes(setup: Setup) -> PlantSpec | None:
    spec = setup.plant
    if spec.infinite_plate or spec.plate.simply_supported is None:
        return None
    # Beyond 1/(2 step) is what the steps of a held force put in, which no sample carries.
    limit_hz = min(finer_spec(setup).frequency_limit_hz, 0.5 / setup.step_s)
    if limit_hz <= spec.frequency_limit_hz:
        return None
    return replace(spec, frequency_limit_hz=limit_hz)


def as_json(found: LawAccuracy | None) -> dict[str, Any] | None:
    """For --json: as in `LawAccuracy`, with the changes as in `Verification`."""
    if found is None:
        return None
    return {**asdict(found), "largest": found.by_modes.largest, "kept": found.kept}
