"""Keys of the measuring chain."""

FILTERS = ("low_pass_hz", "ac_coupling_hz", "resonance_hz", "resonance_damping")
WITHOUT_CONTROL = "The records are simulated without control: no law, no latency, no force."


def is_chain_key(key: str) -> bool:
    """Whether a scene key is of the measuring chain alone: no simulation depends on it."""
    return key.startswith("sensors.")
