"""How stable the loop of a scene is: in flight, with a varying latency, and in contact."""

from collections.abc import Callable

from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.setup import Setup
from hertzloop.studies.margin.binding import binding_mode
from hertzloop.studies.margin.contact import contact_margin, impact_facts
from hertzloop.studies.margin.flight import margin_of
from hertzloop.studies.margin.jitter import at_shortest_latency, jitter_margin_of
from hertzloop.studies.margin.result import MarginResult


def margin(setup: Setup, on_part: Callable[[str], None] = lambda part: None) -> MarginResult:
    """Return how stable the loop of a scene is.

    A law without a linear loop in flight has a margin in contact if it acts on the contact force,
    else the time of its first force.

    Args:
        setup: The scene with its law.
        on_part: Called with the name of each part of the analysis as it begins.

    Raises:
        SceneError: the scene cannot be simulated.
    """
    constant = at_shortest_latency(setup)
    on_part("latency and gain in flight")
    flight = margin_of(constant)
    if flight.applicable:
        on_part("binding mode and jitter")
        at_hz = flight.binding_frequency_hz
        mode = None if at_hz is None else binding_mode(constant, at_hz)
        return MarginResult(flight, jitter_margin_of(setup, flight), mode)
    if not setup.has_law or not SCHEMES[setup.scheme].has_linear_model:
        return MarginResult(flight)
    on_part("loop in contact")
    in_contact = contact_margin(setup)
    if isinstance(in_contact, str):
        return MarginResult(flight, impact=impact_facts(setup))
    return MarginResult(flight, contact=in_contact)
