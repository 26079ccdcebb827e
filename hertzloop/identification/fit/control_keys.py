"""Scene keys of the law and of the actuator: what they change, and which of them can be free."""

from hertzloop.scene.setup import Setup

# What changes the force of the actuator alone, beside all keys of the controller.
_OF_ACTUATOR = ("bandwidth_hz", "damping", "force_limit_n", "dead_time_us")
_NOT_OF_ONE_RUN = ("jitter_us", "clock_ppm", "clock_phase", "drop_out_probability")


def is_control_key(key: str) -> bool:
    """Whether a key changes nothing but the force of the actuator."""
    table, _, last = key.partition(".")
    return table == "controller" or (table == "actuator" and last != "mass_kg")


def why_not_free(key: str) -> str | None:
    """Return why a key of controller or actuator cannot be free under a law; None if it can."""
    table, _, last = key.partition(".")
    if table == "controller" and last in _NOT_OF_ONE_RUN:
        return "a record of one run cannot tell it. Set it with --set"
    if table == "actuator" and last not in (*_OF_ACTUATOR, "mass_kg"):
        return f"of the actuator only {', '.join((*_OF_ACTUATOR, 'mass_kg'))} can be free"
    return None


def resolution_us(setup: Setup, key: str) -> float | None:
    """Return the distance of the values of a key in whole steps, us; None of another key."""
    table, _, last = key.partition(".")
    if key == "actuator.dead_time_us" or (
        table == "controller" and last in setup.scene.controller.whole_step_keys
    ):
        return setup.step_ns / 1000
    return None
