"""The linear loop of a setup in flight: sampled plant, law, and latency."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from hertzloop.plant.schemes.registry import SCHEMES, schemes_where
from hertzloop.scene.controller import loaded_law
from hertzloop.scene.setup import Setup, resolve
from hertzloop.studies.margin.identify import NotLinearError, law_filter
from hertzloop.studies.margin.law_filters import INSIDE
from hertzloop.studies.margin.linear import TransferFunction, plant_in_flight
from hertzloop.studies.margin.table import Loop


@dataclass(frozen=True)
class PolyphaseLoop:
    """The linear loop of a setup in flight: one `Loop` for each remainder of the latency by the
    sampling interval."""

    plant: TransferFunction
    every: tuple[Loop, ...]
    lead: int  # steps from a sample to its force at latency 0: one, and dead time

    @classmethod
    def of(
        cls, plant: TransferFunction, law: TransferFunction, every: int = 1, lead: int = 0
    ) -> "PolyphaseLoop":
        """Return the loop of a plant whose law is sampled every `every` steps."""
        return cls(plant, tuple(Loop(plant.held(every, r), law) for r in range(every)), lead)

    def at(self, latency: int) -> tuple[Loop, int]:
        """Return the loop for a latency in steps, and its delay in samples."""
        delay, rest = divmod(latency + self.lead, len(self.every))
        return self.every[rest], delay

    def unstable(self, latency: np.ndarray) -> np.ndarray:
        """Return the number of closed-loop poles outside the unit circle, by latency in steps."""
        whole, rest = np.divmod(np.asarray(latency) + self.lead, len(self.every))
        found = np.empty(len(whole), int)
        for r in np.unique(rest):
            found[rest == r] = self.every[r].table.unstable(whole[rest == r])
        return found


NO_LAW = "the scene has no law, so there is no loop"


def why_no_loop(setup: Setup) -> str:
    """Return why a setup cannot have a linear loop in flight, before its law is looked at; empty if
    it may have one."""
    if not setup.scene.controller.has_law:
        return NO_LAW
    if not SCHEMES[setup.run.scheme].accepts("margin"):
        return (
            f"run.scheme = '{setup.run.scheme}' has no linear model; use "
            f"{schemes_where(lambda row: row.accepts('margin'))}"
        )
    if setup.scene.sensors.quantity == "contact_force":
        return "the contact force is zero in flight, so the loop is closed in contact only"
    return ""


def loop_setup(setup: Setup, **control: Any) -> Setup:
    """Return the setup that stands for all setups with the same loop."""
    scene = setup.scene
    run = scene.run.replaced(
        seed=0, touch_phase=0.0, plate_model="modal", duration_s=scene.run.lead_in_s + 1e-3
    )
    controller = scene.controller.replaced(**control)
    return resolve(scene.replaced(name="loop", shows="", run=run, controller=controller))


def law_digest(setup: Setup) -> str:
    """Return what tells two versions of a user's law apart."""
    return "" if setup.scene.controller.law_is_shipped else loaded_law(setup).digest


@lru_cache(maxsize=16)
def _loops(setup: Setup, digest: str) -> PolyphaseLoop | NotLinearError:
    """Return the loops of a setup, or why it has none; `digest` belongs to the key."""
    try:
        law = law_filter(setup)
    except NotLinearError as error:
        return error
    lead = 1 + setup.signal_path.dead_steps
    return PolyphaseLoop.of(damped(plant_in_flight(setup)), law, setup.sensor.every_steps, lead)


def damped(plant: TransferFunction) -> TransferFunction:
    """Return a plant whose poles on the unit circle, those of modes without damping, are just
    inside it.

    The loop gain has no value at a pole on the circle. This is the limit of vanishing damping, and
    changes growths by less than 1e-3 1/s at a step of 1 us.
    """
    size = np.abs(plant.poles)
    inside = np.where(size > 1.0 - INSIDE, plant.poles * (1.0 - INSIDE) / size, plant.poles)
    return replace(plant, poles=inside)


def loops_of(setup: Setup) -> PolyphaseLoop | NotLinearError:
    """Return the linear loop of a setup, or why it has none.

    That of a shipped law serves all latencies; only a user's law may know its own.

    Raises:
        SceneError: the scene is invalid.
    """
    digest = law_digest(setup)
    shares = setup.scene.controller.law_is_shipped and not setup.signal_path.trace
    return _loops(loop_setup(setup, latency_us=0.0) if shares else loop_setup(setup), digest)
