"""How close the default scheme's step comes to what the processor can do at most.

Per frequency and step (8 byte numbers; operations of the multiply-add units, where a lone
product counts like a multiply-add; plain additions have units of their own and do not count):

| pass | read | bytes read | operations |
|---|---|---|---|
| flight | z 2, ROT 2, OUT 1 | 40 | turn 4, displacement 1, velocity 1: 6 |
| contact | z 2, ROT 2, C0 2, C1 2, OUT 1 | 72 | fold 4, turn 4, displacement 1, swing 3: 12 |
| contact, loss booked | the same, then z 2, LOSS 7 | 144 | 12 + 9 = 21 |

Every pass also writes z, 16 bytes, which leave by a port of their own. The floor of a step is
the larger of bytes over the bandwidth of the cache level that holds the pass's numbers, and
operations over the peak rate (Williams, Waterman and Patterson 2009). Both peaks are measured in
turn with the passes: reading what the pass reads where it lies, and independent chains of
multiply-adds. Smallest times of all rounds are set against each other.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.baseline import in_turn, timed, two_pass_case
from benchmarks.roofline_kernels import (
    MULTIPLY_ADDS,
    drifts,
    loads,
    multiply_adds,
    pushes,
    repeated_steps,
)
from hertzloop.plant.schemes import collocation_kernels as collocation
from hertzloop.plant.schemes import collocation_kernels as modes
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.state_kernels import FLIGHT_X
from hertzloop.scene.setup import load

_ROUNDS = 200
_REPEATS = 300
_SMALL = np.ones(256)
# Columns of the table, columns of the loss, operations: per frequency and step.
_FLIGHT, _CONTACT, _BOOKED = (3, 0, 6), (7, 0, 12), (7, 7, 21)
# Scene, accuracy, steps before the contact's middle, steps measured.
SCENES = [
    ("aluminium-20mm", "1e-9", 400, 50),
    ("aluminium-20mm", "1e-3", 400, 50),
    ("aluminium-3mm", "1e-3", 6, 12),
]
TWO_PASS_FREQUENCIES = 1104


@dataclass(frozen=True)
class Share:
    """A step's floor, the pass alone and the whole step (us), and the whole step in two-pass
    loops over TWO_PASS_FREQUENCIES frequencies."""

    case: str
    frequencies: int
    kilobytes: float
    gigabytes_s: float
    gigaoperations_s: float
    bound: str
    floor_us: float
    pass_us: float
    step_us: float
    of_two_pass: float


@dataclass(frozen=True)
class Case:
    """A pass: columns it reads beside z, operations per frequency; a plant to run it on."""

    columns: int
    loss_columns: int
    operations: int
    model: collocation.CollocationModel
    state: collocation.CollocationState

    @property
    def held(self) -> int:
        """Numbers per frequency."""
        return 2 + self.columns + self.loss_columns

    @property
    def read(self) -> int:
        """Numbers read per frequency: z twice where the loss is booked."""
        return self.held + (2 if self.loss_columns else 0)


def cases(scene: str, accuracy: str, before: int, _: int) -> dict[str, Case]:
    """Flight over a ringing plate and contact, without damping and with its balance."""
    found = {}
    for what, numbers, settings in (
        ("flight", _FLIGHT, ["plate.loss_factor=0"]),
        ("contact", _CONTACT, ["plate.loss_factor=0"]),
        ("contact, booked", _BOOKED, []),
    ):
        wanted = [f"run.accuracy={accuracy}", "run.lead_in_s=0", *settings]
        plant = CollocationPlant(load(scene, wanted).plant)
        ik.plant_steps(plant.model, plant.state, 0.0, before)
        if what == "flight":
            plant.state.body[FLIGHT_X] += 1.0
            ik.plant_steps(plant.model, plant.state, 0.0, 2)
        found[f"{what}, {scene.removeprefix('aluminium-')}, {accuracy}"] = Case(
            *numbers, plant.model, plant.state
        )
    return found


def _measures(name: str, case: Case, count: int) -> dict[str, Callable[[], float]]:
    """us: reading a byte, the pass alone, a step with its share of going back to the start,
    that share."""
    model, kept = case.model, case.state
    state = kept._replace(**{n: array.copy() for n, array in kept._asdict().items()})
    z = kept.z.copy()
    columns = model.table[: case.columns].ravel()
    losses = model.table[modes.LOSS_RR : modes.LOSS_RR + case.loss_columns].ravel()
    read = 8 * case.read * z.shape[1]
    rounds = _REPEATS // count + 1

    def alone() -> float:
        if name.startswith("flight"):
            return drifts(model, z, _REPEATS)
        # Pushed by next to nothing.
        return pushes(model, z, 1e-9, 1e-9, model.damped, _REPEATS)

    def steps(each: int) -> float:
        return repeated_steps(model, state, kept, each, rounds)

    return {
        f"load {name}": lambda: timed(
            lambda: loads(columns, losses, z.ravel(), _REPEATS), _REPEATS * read
        ),
        f"pass {name}": lambda: timed(alone, _REPEATS),
        f"step {name}": lambda: timed(lambda: steps(count), rounds * count),
        f"back {name}": lambda: timed(lambda: steps(0), rounds * count),
    }


def shares(rounds: int = _ROUNDS) -> list[Share]:
    """Roofline of flight and contact step on aluminium, all measured in turn."""
    measures: dict[str, Callable[[], float]] = {
        "two-pass": two_pass_case(TWO_PASS_FREQUENCIES),
        "peak": lambda: timed(
            lambda: multiply_adds(_SMALL, _REPEATS), _REPEATS * _SMALL.size * MULTIPLY_ADDS
        ),
    }
    found: dict[str, Case] = {}
    for scene in SCENES:
        for name, case in cases(*scene).items():
            found[name] = case
            measures |= _measures(name, case, scene[3])
    least = {cost.case: cost.least_us for cost in in_turn(measures, rounds)}
    return [_share(name, case, least) for name, case in found.items()]


def _share(name: str, case: Case, least: dict[str, float]) -> Share:
    frequencies = case.state.z.shape[1]
    memory = 8 * case.read * frequencies * least[f"load {name}"]
    arithmetic = case.operations * frequencies * least["peak"]
    step_us = least[f"step {name}"] - least[f"back {name}"]
    return Share(
        case=name,
        frequencies=frequencies,
        kilobytes=8 * case.held * frequencies / 1024,
        gigabytes_s=1e-3 / least[f"load {name}"],
        gigaoperations_s=1e-3 / least["peak"],
        bound="memory" if memory > arithmetic else "arithmetic",
        floor_us=max(memory, arithmetic),
        pass_us=least[f"pass {name}"],
        step_us=step_us,
        of_two_pass=step_us / least["two-pass"],
    )
