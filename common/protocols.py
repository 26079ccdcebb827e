"""The contract of ring 1: what the parts ask of each other, and of what a user brings.

A structure, the file of a law, a quantity that a sensor measures, a port of the bus, an exchange of
the loop, and a reader of recordings. What we ship and what a user brings use the same contract. The
parts that fulfil them are named in each docstring.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

if TYPE_CHECKING:  # the parts import this file
    import numpy as np
    from pydantic import BaseModel

    from hertzloop.bus.streams import Envelope
    from hertzloop.controller.law import ForceBound, LawContext, Response
    from hertzloop.plant.structures.materials import Material
    from hertzloop.plant.structures.mode_file import ModeTable
    from hertzloop.plant.structures.modes import Modes
    from hertzloop.plant.structures.plate import Plate
    from hertzloop.recordings.recording import Recording

Point = tuple[float, float]  # m, from the structure's corner


class Structure(Protocol):
    """Anything linear that a sphere can fall on: its modes, and what it offers beyond them.

    A class inherits from this one, and with it an answer to whatever it does not offer: a member
    with a body holds for any set of modes. See `plant/structures/`.
    """

    if TYPE_CHECKING:  # else a dataclass could not have a field of this name

        @property
        def material(self) -> Material:
            """Material of the surface at the contact point."""

    @abstractmethod
    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency."""

    @abstractmethod
    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s."""

    @abstractmethod
    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max`, m/N, at a point, or (None) about."""

    def same_point(self, contact_m: Point, actuator_m: Point) -> bool:
        """Whether the actuator pushes at the contact point."""
        return contact_m == actuator_m

    def sensed(self, omega_max: float, contact_m: Point, sensor_m: Point) -> np.ndarray:
        """Shapes of all modes up to `omega_max` where a sensor is, (modes,)."""
        return self.modes(omega_max, contact_m, sensor_m).at_actuator

    def sensor_at(
        self, contact_m: Point, actuator_m: Point, sensor_m: Point | None
    ) -> Point | None:
        """Where a sensor is that a scene puts at `sensor_m`; None: at the contact point."""
        return None if sensor_m == contact_m else sensor_m

    has_shapes: bool = False
    """whether `on_grid` can be asked for them"""
    grid_m: tuple[np.ndarray, np.ndarray] | None = None
    """axes (ascending, m) of the only grid that has its shapes; None: they are known anywhere"""
    mode_table: ModeTable | None = None
    """the modes that it was given as, which end; None where modes are computed"""
    highest_hz: float = math.inf
    """up to where its modes are known, Hz; inf without limit"""
    seconds_per_mode: float = 1e-5
    """about how much processor time it takes to compute a mode, s"""
    quality: Mapping[str, Any] | None = None
    """how good its modes are, by name; None of a closed form"""

    @property
    def struck_at_actuator(self) -> Self:
        """The structure with the contact where the actuator is, if the points do not say that."""
        return self

    @property
    def pushed_at_sensor(self) -> Self:
        """The structure with the actuator where the sensor is, if the points do not say that."""
        return self

    @property
    def local_plate(self) -> Plate | None:
        """The plate that a contact feels until reflections return; None if there is none."""
        return None

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y). Raises ValueError without
        `has_shapes`."""
        raise ValueError(f"{self} has no shapes on a grid")

    @property
    def simply_supported(self) -> Plate | None:
        """The simply supported plate that it is, whose modes are products of sines; None if it is
        none. Radiation efficiencies are known of these only."""
        return None

    @property
    def fundamental_hz(self) -> float | None:
        """Frequency of its lowest mode, Hz, where that is known without its modes."""
        return None


class LawFile(Protocol):
    """What the file of a law, or a class in it, defines. Only `command` is required.

    Numba compiles `command`, `known_ahead`, `command_ahead` and `trigger_level`. They get the
    constants `p`, the state `s`, and samples of which those up to `i` are known. The others are
    called in Python, before the run. See `controller/laws/` and docs/how-to/laws.md.
    """

    senses: str = "xi"
    """quantity that it needs, "any", or several with commas, the default first"""
    latches: bool = False
    """whether `s.delay` is a delay in samples that it latches"""
    open_loop: bool = False
    """whether its forces are known before the run"""
    not_linear: str = ""
    """why it has no linear margin, as a clause"""
    Parameters: type[BaseModel]
    """its scene keys, a subclass of `Keys`"""
    State: type
    """its state at the start: numbers and arrays of numbers"""

    @staticmethod
    def command(p: Any, s: Any, samples: Any, i: int) -> float:
        """Force of sample `i`, N, positive upwards."""

    @staticmethod
    def known_ahead(p: Any, s: Any, samples: Any, i: int) -> int:
        """Promise: how many commands after that of sample `i` are certain."""

    @staticmethod
    def command_ahead(p: Any, s: Any, samples: Any, i: int, j: int) -> float:
        """The certain command of sample `j`, N."""

    @staticmethod
    def trigger_level(p: Any, s: Any) -> float:
        """Promise: no force while samples stay above this level."""

    @staticmethod
    def prepare(keys: Any, about: LawContext) -> Any:
        """Constants `p`, a NamedTuple of numbers and arrays. Raises LawError to refuse keys."""

    @staticmethod
    def transfer_function(keys: Any, p: Any) -> Response | None:
        """Transfer function of a linear law."""

    @staticmethod
    def force_bound(keys: Any) -> ForceBound:
        """Bound of the force, which may allow a cheaper model of the plate."""

    @staticmethod
    def note(keys: Any) -> str:
        """A sentence that a command prints before a run."""

    @staticmethod
    def read_files(keys: dict[str, Any], folder: Path) -> None:
        """Replace keys that name a file by what it holds; paths are relative to `folder`."""

    @staticmethod
    def tune(about: LawContext) -> dict[str, tuple[float, float]]:
        """Ranges of its keys that `tune` searches."""


class ExpectedImpact(NamedTuple):
    """How far an impact goes, on a rigid plate; `flight_m` above it a law has to see the sphere,
    `velocity_m_s()` is that of the plate, which something else than a plate has not."""

    rigid_m: float
    deepest_m: float  # the same, where the contact yields
    flight_m: float
    force_n: float
    velocity_m_s: Callable[[], float]
    contact_s: float


class TrialImpact(NamedTuple):
    """A made-up impact that a law is tried on, a value a sample; shapes (samples,)."""

    gap_m: np.ndarray
    force_n: np.ndarray
    velocity_m_s: np.ndarray  # of the plate
    sample_s: float


class SensedQuantity(NamedTuple):
    """A quantity that a sensor can measure: a row of `SENSED`, `hertzloop/scene/quantities.py`."""

    unit: str
    meaning: str
    of_state: int  # index into the plant's state
    range: Callable[[ExpectedImpact], tuple[float, float]]  # of a converter: lowest, highest value
    trial: Callable[[TrialImpact], np.ndarray]  # samples of the made-up impact
    over_step: bool = False  # a mean over the step before the sample, not a value at its time
    elsewhere: int | None = None  # index of the same where a sensor elsewhere is; None: no such


class Port(Protocol):
    """One role's access to the bus. Delivery is in order and complete per stream.

    See `InProcessPort` in `bus/port.py` and `bus/zenoh_port.py`.
    """

    role: str

    def publish(self, envelope: Envelope) -> None:
        """Send to everyone who subscribed. Blocks when they cannot keep up."""

    def receive(self, timeout_s: float, awaited: str, senders: Collection[str] = ()) -> Envelope:
        """Next message for this role. Raises PeerLost after `timeout_s` seconds without one, and
        soon after a role of the run has gone without a word. The sentence says what was `awaited`;
        `roles` of the error are those of the `senders` that take part."""

    def pending(self) -> bool:
        """Whether `receive` would return at once."""

    def close(self) -> None:
        """Leave the bus."""


class ExchangeFunctions(Protocol):
    """What the loop asks an exchange in a step; compiled, `hertzloop/closed_loop/exchange.py`.

    `unsent` holds the samples and time series that were not sent yet, `step` is the present step,
    `end` that at which the call of the loop ends. A status is GO, or why the loop ends here.
    """

    @staticmethod
    def await_step(exchange: Any, unsent: Any, step: int, end: int) -> int:
        """Wait until a step may be observed; return the status."""

    @staticmethod
    def put(exchange: Any, unsent: Any, step: int, value: float) -> None:
        """Pass on the sample of a step."""

    @staticmethod
    def force_for(exchange: Any, unsent: Any, step: int, end: int) -> tuple[float, int]:
        """The command that acts in a step, N, and the status."""

    @staticmethod
    def is_over(exchange: Any, side: Any, unsent: Any, gap: float) -> bool:
        """Whether no later step can belong to the impact that is followed, if there is one."""


class Reader(Protocol):
    """What reads a file of streams: `read` in `recordings/reader.py`."""

    def __call__(self, path: Path) -> Recording:
        """Streams up to the first damage, each without a gap, and in sentences what is missing.
        Raises RecordingError where there is no file, or none of this format."""
