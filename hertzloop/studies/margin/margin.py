"""How stable the loop of a scene is in flight, also with a latency that varies."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import BindingMode, binding_mode
from hertzloop.studies.margin.flight import Margin, margin_of
from hertzloop.studies.margin.jitter import JitterMargin, at_shortest_latency, jitter_margin_of


@dataclass(frozen=True)
class MarginResult:
    """What linear theory says about a scene with its law.

    Attributes:
        flight: Margin of the loop in flight, at the shortest latency of the scene.
        jitter: How far the latency may vary; None without a linear loop.
        binding_mode: Mode of the structure that limits the loop; None without one.
    """

    flight: Margin
    jitter: JitterMargin | None = None
    binding_mode: BindingMode | None = None

    def as_data(self) -> dict[str, Any]:
        """Return the result as the data of `--json`."""
        data = asdict(self)
        return data.pop("flight") | data


def margin(setup: Setup, on_part: Callable[[str], None] = lambda part: None) -> MarginResult:
    """Return how stable the loop of a scene is in flight.

    Args:
        setup: The scene with its law.
        on_part: Called with the name of each part of the analysis as it begins.

    Raises:
        SceneError: the scene cannot be simulated.
    """
    constant = at_shortest_latency(setup)
    on_part("latency and gain in flight")
    flight = margin_of(constant)
    if not flight.applicable:
        return MarginResult(flight)
    on_part("binding mode and jitter")
    at_hz = flight.binding_frequency_hz
    mode = None if at_hz is None else binding_mode(constant, at_hz)
    return MarginResult(flight, jitter_margin_of(setup, flight), mode)
