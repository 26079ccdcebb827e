"""The result of `margin`: the loop in flight."""

from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.studies.margin.binding import BindingMode
from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.jitter import JitterMargin


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
        parts = {"binding_mode": self.binding_mode, "jitter": self.jitter}
        data = {name: None if part is None else asdict(part) for name, part in parts.items()}
        return asdict(self.flight) | data
