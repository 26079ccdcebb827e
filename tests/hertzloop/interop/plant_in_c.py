"""An exported plant for tests, on this machine's instructions: compiled once, linked per scene."""

import ctypes
from pathlib import Path

import numpy as np

from hertzloop.interop.fmu import VALUES, write_folder
from hertzloop.interop.image import image
from hertzloop.interop.objects import HOST
from hertzloop.scene.setup import Setup

SHORT = ("run.duration_s=0.002", "run.plate_model=modal")
# All that a sensor can have, a random touch phase, and a seed that only they use.
NOISY = (
    *SHORT,
    "sensors.noise_rms=1e-7",
    "sensors.bits=12",
    "sensors.every_steps=2",
    "run.touch_phase=random",
    "run.seed=77",
    "sensors.low_pass_hz=400000",
    "sensors.low_pass=bessel",
    "sensors.low_pass_order=5",
    "sensors.ac_coupling_hz=1",
)


def exported(folder: Path, scene: Setup) -> Path:
    """The folder with library, header and example of a scene's plant."""
    write_folder(image(scene), HOST, folder)
    return folder


class About(ctypes.Structure):
    """hertzloop_about."""

    _fields_ = (
        ("scene", ctypes.c_char_p),
        ("processor", ctypes.c_char_p),
        ("quantity", ctypes.c_char_p),
        ("step_s", ctypes.c_double),
        ("every_steps", ctypes.c_int64),
        ("steps", ctypes.c_int64),
        ("drop_height_m", ctypes.c_double),
        ("seed", ctypes.c_int64),
        ("state_bytes", ctypes.c_size_t),
    )


class InC:
    """A plant of a library in this process."""

    def __init__(self, library: Path) -> None:
        self.c = ctypes.CDLL(str(library))
        kinds = {
            "about": ctypes.POINTER(About),
            "new": ctypes.c_void_p,
            "said": ctypes.c_char_p,
            "refused": ctypes.c_char_p,
        }
        for name, kind in kinds.items():
            getattr(self.c, f"hertzloop_plant_{name}").restype = kind
        self.about: About = self.c.hertzloop_plant_about().contents
        self.plant = ctypes.c_void_p(self.c.hertzloop_plant_new())

    def step(self, command: float, steps: int = 1) -> int:
        """Status of some steps."""
        return int(
            self.c.hertzloop_plant_step(self.plant, ctypes.c_double(command), ctypes.c_int64(steps))
        )

    def reset(self, drop_height_m: float, seed: int) -> int:
        """Status of going back to the start."""
        return int(
            self.c.hertzloop_plant_reset(
                self.plant, ctypes.c_double(drop_height_m), ctypes.c_int64(seed)
            )
        )

    def values(self) -> np.void:
        """What is seen now."""
        seen = np.zeros(1, VALUES)
        self.c.hertzloop_plant_values(self.plant, ctypes.c_void_p(seen.ctypes.data))
        return seen[0]

    def run(self, forces: np.ndarray) -> np.ndarray:
        """What is seen after each of some steps."""
        seen = np.zeros(len(forces), VALUES)
        for i, force in enumerate(forces):
            assert self.step(float(force)) == 0
            seen[i] = self.values()
        return seen

    def state(self) -> bytes:
        """The whole state."""
        state = ctypes.create_string_buffer(self.about.state_bytes)
        self.c.hertzloop_plant_get_state(self.plant, state)
        return state.raw

    def set_state(self, state: bytes) -> int:
        """Status of coming back to a state."""
        return int(self.c.hertzloop_plant_set_state(self.plant, state))

    def said(self) -> str:
        """The last complaint."""
        return str(self.c.hertzloop_plant_said(self.plant).decode())
