"""The real plant: the scene without its idealisations, as far as the scene accepts that."""

from typing import Any

from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.quantities import converter_width

# A plate in three dimensions takes a hundred times as long as a thin one.
_QUICK_WITHOUT = ("plate.theory", "run.accuracy")
# At an accuracy of 1e-3 a solid's modes end at 244 kHz, and velocity fed back 3, 7 or 11 us late
# excites that end: an instability that modes up to half the sampling frequency do not show.
REAL: dict[str, Any] = {
    "run.accuracy": 1e-4,
    "contact.plasticity": "thornton",
    "plate.theory": "3d",
    "actuator.bandwidth_hz": 300e3,
    "actuator.damping": 0.7,
    "sensors.bits": 16,
}
NOISE = 1e-4  # rms, of the converter's range, in the real plant


def real_plant(setup: Setup, quick: bool = False) -> tuple[Setup, tuple[str, ...]]:
    """Return the scene with a contact that yields, a solid plate, an actuator with a bandwidth, and
    a converter with noise, each where the scene is ideal and accepts it.

    Args:
        setup: The scene.
        quick: Leave the plate thin, which costs a hundredth of the time.

    Returns:
        The setup, and the keys that the scene does not accept.
    """
    found, left_out = setup, []
    for key, value in REAL.items():
        if quick and key in _QUICK_WITHOUT:
            continue
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
    """Whether a scene leaves a key as it is by default: what it says otherwise stays. An accuracy
    is ideal if it is coarser than that of the real plant."""
    table, _, name = key.partition(".")
    given = getattr(setup.scene, table)
    if key == "run.accuracy":
        return setup.accuracy > REAL[key]
    if key == "actuator.damping":
        return setup.scene.actuator.bandwidth_hz is None
    return bool(getattr(given, name) == type(given).model_fields[name].default)
