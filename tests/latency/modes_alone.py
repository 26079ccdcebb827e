"""A plate of its modes alone, with nothing in the place of those above the highest one."""

import math
from pathlib import Path

from hertzloop.plant.plant import modes_of
from hertzloop.scene.setup import load


def modes_alone(scene: str, accuracy: float, file: Path) -> list[str]:
    """Settings for the undamped modes of a shipped scene at an accuracy, kept in `file`."""
    modes = modes_of(load(scene, [f"run.accuracy={accuracy}", "run.plate_model=modal"]).plant)
    rows = [
        f"{omega / (2.0 * math.pi)!r},0,{1.0 / modes.scale_per_kg!r},{weight!r}"
        for omega, weight in zip(modes.omega.tolist(), modes.contact.tolist(), strict=True)
    ]
    columns = "frequency_hz,loss_factor,modal_mass_kg,shape_contact"
    file.write_text("\n".join(["# residual_flexibility_m_n = 0", columns, *rows]) + "\n")
    return [f"plate.modes='{file}'", "run.plate_model=modal"]
