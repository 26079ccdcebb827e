"""The result of `margin`: the loop in flight, and what is known of a law without a linear loop."""

from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.studies.margin.binding import BindingMode
from hertzloop.studies.margin.contact import ContactMargin, ImpactFacts
from hertzloop.studies.margin.flight import Margin
from hertzloop.studies.margin.jitter import JitterMargin


@dataclass(frozen=True)
class MarginResult:
    """What linear theory says about a scene with its law.

    Attributes:
        flight: Margin of the loop in flight, at the shortest latency of the scene.
        jitter: How far the latency may vary; None without a linear loop.
        binding_mode: Mode of the structure that limits the loop; None without one.
        contact: Margin of the loop in contact, for a law on the contact force.
        impact: When the first force acts, for a law that is not linear.
    """

    flight: Margin
    jitter: JitterMargin | None = None
    binding_mode: BindingMode | None = None
    contact: ContactMargin | None = None
    impact: ImpactFacts | None = None

    def as_data(self) -> dict[str, Any]:
        """Return the result as the data of `--json`."""
        parts = {
            "binding_mode": self.binding_mode,
            "jitter": self.jitter,
            "contact": self.contact,
            "impact": self.impact,
        }
        data = {name: None if part is None else asdict(part) for name, part in parts.items()}
        return asdict(self.flight) | data
