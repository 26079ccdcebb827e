"""Exported plants in this process, many at a time: one call steps them all."""

import ctypes
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hertzloop.elsewhere.driven import ENERGIES, VALUES
from hertzloop.elsewhere.image import image
from hertzloop.elsewhere.library import write_library
from hertzloop.elsewhere.objects import HOST
from hertzloop.setup import Setup


class Batch:
    """Some plants of one scene; `values`: what each showed last, of the fields of VALUES.

    Raises SceneError, NoCompiler and CompileFault.
    """

    def __init__(self, setup: Setup, count: int) -> None:
        self._folder = TemporaryDirectory(prefix="hertzloop-")
        library = Path(self._folder.name) / "plants.so"
        write_library(image(setup), HOST, library)
        self._c = ctypes.CDLL(str(library))
        self._c.hertzloop_plant_new.restype = ctypes.c_void_p
        self._c.hertzloop_plant_said.restype = ctypes.c_char_p
        self._c.hertzloop_plant_step_all.restype = ctypes.c_int64
        self.setup = setup
        self.values = np.zeros(count, VALUES)
        self._plants = np.zeros(count, np.intp)
        for i in range(count):
            self._plants[i] = self._c.hertzloop_plant_new() or 0
            if not self._plants[i]:
                self.close()
                raise MemoryError(f"there is no memory for {count} plants")

    def start(self, index: int, seed: int, steps: int) -> None:
        """Put a plant to its start, with a seed, and let it fall for some steps."""
        plant = ctypes.c_void_p(int(self._plants[index]))
        height = ctypes.c_double(self.setup.sphere.drop_height_m)
        self._c.hertzloop_plant_reset(plant, height, ctypes.c_int64(seed))
        self._c.hertzloop_plant_step(plant, ctypes.c_double(0.0), ctypes.c_int64(steps))
        seen = self.values.ctypes.data + index * VALUES.itemsize
        self._c.hertzloop_plant_values(plant, ctypes.c_void_p(seen))

    def step(self, which: np.ndarray, commands_n: np.ndarray, steps: int) -> None:
        """Steps of the plants `which` (indices), each under a command. Raises ValueError."""
        plants, forces = self._plants[which], np.ascontiguousarray(commands_n, float)
        seen = np.zeros(len(plants), VALUES)
        went = self._c.hertzloop_plant_step_all(
            ctypes.c_void_p(plants.ctypes.data), ctypes.c_void_p(forces.ctypes.data),
            ctypes.c_int64(len(plants)), ctypes.c_int64(steps), ctypes.c_void_p(seen.ctypes.data),
        )  # fmt: skip
        self.values[which[:went]] = seen[:went]
        if went < len(plants):
            plant = ctypes.c_void_p(int(plants[went]))
            raise ValueError(self._c.hertzloop_plant_said(plant).decode())

    def energies(self, index: int) -> dict[str, float]:
        """Energies of a plant, by name."""
        found = (ctypes.c_double * len(ENERGIES))()
        self._c.hertzloop_plant_energies(ctypes.c_void_p(int(self._plants[index])), found)
        return dict(zip(ENERGIES, found, strict=True))

    def close(self) -> None:
        """Let go of the plants."""
        for plant in self._plants[self._plants != 0]:
            self._c.hertzloop_plant_free(ctypes.c_void_p(int(plant)))
        self._plants[:] = 0
        self._folder.cleanup()
