"""What an exported plant carries with it: its model's arrays, the state at the start, constants.

`image.bin` holds the words that the kernels are put together from, relocations (index of the word,
which memory, offset), the state and the model; `image.h` says where.
"""

import hashlib
import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from hertzloop.closed_loop.exchange import HELD, SAMPLES_END
from hertzloop.closed_loop.parts import elsewhere, empty_unsent, exchange, plant_side
from hertzloop.interop.kernels import ENERGIES, Unit
from hertzloop.interop.object_code import leaves
from hertzloop.interop.objects import needed
from hertzloop.plant.schemes.registry import SCHEMES, schemes_where
from hertzloop.plant.state_kernels import STEP, V_P, XI, XI_P, XI_S
from hertzloop.plant.time_series import F_A, F_C
from hertzloop.scene.build import build_plant, build_sensor
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.setup import Setup
from hertzloop.sensors.acquisition import NOISE_STREAM

_MODEL, _STATE, _NOISE = range(3)
_LINE, _WORD = 64, 8


@dataclass(frozen=True)
class Image:
    """A plant to export: its scene and kernels' unit, the binary image, the constants by name."""

    setup: Setup
    unit: Unit
    data: bytes
    constants: dict[str, Any]

    def header(self, cpu: str) -> str:
        """The text of image.h for code of a processor."""
        looks = " ".join(f"LOOK({json.dumps(name)})" for name in needed(cpu))
        lines = [f"#define IMAGE_{name} {_in_c(value)}" for name, value in self.constants.items()]
        return "\n".join(
            [
                "/* Generated. */",
                *lines,
                f"#define IMAGE_PROCESSOR {_in_c(cpu)}",
                f"#define IMAGE_NEEDS(LOOK) {looks}",
                "",
            ]
        )


def image(setup: Setup) -> Image:
    """The image of a scene's plant and sensor. Raises SceneError for a scheme that cannot go."""
    if not SCHEMES[setup.run.scheme].accepts("export-plant"):
        raise SceneError(
            f"run.scheme = {setup.run.scheme!r} cannot be exported. "
            f"Use {schemes_where(lambda row: row.accepts('export-plant'))}."
        )
    plant, sensor = build_plant(setup), build_sensor(setup)
    unit = Unit(
        plant_side(plant, sensor),
        exchange(HELD, elsewhere(np.zeros(1))),
        empty_unsent(1, 1),
        np.zeros(2),
        np.zeros(ENERGIES),
        float(setup.run.lead_in_s),
    )
    memory = _Memory()
    side, unsent = unit.side, unit.unsent
    memory.take(_MODEL, side.plant)
    memory.take(_STATE, side.plant_state)
    memory.take(_MODEL, side.sensor, noise=side.sensor.noise)
    for part in (
        *side[side._fields.index("sensor_state") :],
        *unit[unit._fields.index("exchange") :],
    ):
        memory.take(_STATE, part)
    # One sample more than the loop takes, after the last step.
    count = setup.run.steps // setup.sensor.every_steps + 1 if side.sensor.noise.size else 0
    data, places = memory.laid_out(count)
    at = memory.offset_of
    body, truth = at(side.plant_state.body), at(unsent.truth)
    phase = setup.scene.run.touch_phase
    sensed = SENSED[setup.scene.sensors.quantity]
    constants = {
        "SCENE": setup.scene.name,
        "QUANTITY": f"{sensed.meaning}, {sensed.unit}",
        "STEP_S": setup.run.step_s,
        "STEPS": setup.run.steps,
        "EVERY_STEPS": setup.sensor.every_steps,
        "DROP_HEIGHT_M": setup.mechanics.sphere.drop_height_m,
        "SEED": setup.run.seed,
        "NOISE": count,
        "NOISE_RMS": setup.sensor.noise_rms,
        "NOISE_STREAM": NOISE_STREAM,
        "PHASE_STREAM": setup.run.PHASE_STREAM,
        "TOUCH_PHASE": -1.0 if phase == "random" else float(phase),
        "DIGEST": int.from_bytes(hashlib.sha256(data).digest()[:7], "little"),
        **places,
        "STEP": at(side.plant_state.counts) + _WORD * STEP,
        "SAMPLES": at(unsent.counts) + _WORD * SAMPLES_END,
        "SAMPLE": at(unsent.values),
        "CODE": at(unsent.codes),
        "CLIPPED": at(unsent.clipped),
        "GAP": body + _WORD * XI,
        "HEIGHT": body + _WORD * XI_S,
        "DEFLECTION": body + _WORD * XI_P,
        "VELOCITY": body + _WORD * V_P,
        "CONTACT_FORCE": truth + _WORD * F_C,
        "ACTUATOR_FORCE": truth + _WORD * F_A,
        "ENERGIES": at(unit.energies),
    }
    return Image(setup, unit, data, constants)


class _Memory:
    """Words and arrays as they are taken in, in the order of the unit's leaves."""

    def __init__(self) -> None:
        self._words: list[bytes] = []
        self._relocations: list[tuple[int, int, int]] = []
        self._blocks = (bytearray(), bytearray())
        self._offsets: dict[int, int] = {}
        self._noise_length = 0

    def take(self, block: int, part: Any, noise: np.ndarray | None = None) -> None:
        """Take in a part, its arrays into a block; that of the noise is made on the target."""
        for leaf in leaves(part):
            if not isinstance(leaf, np.ndarray):
                kind = "d" if isinstance(leaf, float) else "q"
                self._words.append(struct.pack(f"<{kind}", leaf))
                continue
            index = len(self._words)
            self._words += [struct.pack("<q", number) for number in (0, *leaf.shape)]
            if leaf is noise:
                self._relocations.append((index, _NOISE, 0))
                self._noise_length = index + 1
            else:
                held = self._blocks[block]
                self._relocations.append((index, block, len(held)))
                self._offsets[id(leaf)] = len(held)
                held += _padded(np.ascontiguousarray(leaf).tobytes())

    def offset_of(self, array: np.ndarray) -> int:
        """Where an array that was taken in begins in its block."""
        return self._offsets[id(array)]

    def laid_out(self, noise: int) -> tuple[bytes, dict[str, int]]:
        """The image, with so many values of noise, and where its pieces are."""
        self._words[self._noise_length] = struct.pack("<q", noise)
        relocations = b"".join(struct.pack("<3q", *r) for r in self._relocations)
        words = _padded(b"".join(self._words))
        state_at = len(words) + len(_padded(relocations))
        model, state = (bytes(block) for block in self._blocks)
        places = {
            "WORDS": len(self._words),
            "RELOCATIONS": len(self._relocations),
            "RELOCATIONS_AT": len(words),
            "STATE_AT": state_at,
            "STATE_BYTES": len(state),
            "MODEL_AT": state_at + len(state),
        }
        return words + _padded(relocations) + state + model, places


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % _LINE)


def _in_c(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value)
    return value.hex() if isinstance(value, float) else f"INT64_C({value})"
