"""The real plant: the scene without its idealisations, as far as the scene accepts that."""

from typing import Any

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.quantities import converter_width

REAL: dict[str, Any] = {
    "contact.plasticity": "thornton",
    "actuator.bandwidth_hz": 300e3,
    "actuator.damping": 0.7,
    "sensors.bits": 16,
}
NOISE = 1e-4  # rms, of the converter's range, in the real plant


def real_plant(setup: Setup) -> tuple[Setup, tuple[str, ...]]:
    """Return the scene with a contact that yields, an actuator with a bandwidth, and a converter
    with noise, each where the scene is ideal and accepts it.

    Args:
        setup: The scene.

    Returns:
        The setup, and the keys that the scene does not accept.
    """
    found, left_out = setup, []
    for key, value in REAL.items():
        if not _is_ideal(setup, key):
            continue
        try:
            tried = found.vary({key: value})
            _ = tried.plant, tried.sensor  # a stage may refuse what the tables accept
            found = tried
        except SceneError:
            left_out.append(key)
    width = converter_width(found)
    if width and not found.scene.sensors.noise_rms:
        found = found.vary({"sensors.noise_rms": NOISE * width})
    return found, tuple(left_out)


def _is_ideal(setup: Setup, key: str) -> bool:
    """Whether a scene leaves a key as it is by default, or says that the contact is elastic: what
    it says otherwise stays."""
    table, _, name = key.partition(".")
    given = getattr(setup.scene, table)
    if key == "contact.plasticity":
        return setup.scene.contact.plasticity != "thornton"
    if key == "actuator.damping":
        return setup.scene.actuator.bandwidth_hz is None
    return bool(getattr(given, name) == type(given).model_fields[name].default)
