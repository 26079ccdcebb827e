"""Which theory and which tail of a plate a run took, as data and in words."""

from typing import Any

from bus.messages_pb2 import Books
from hertzloop.setup import Setup
from hertzloop.setup.plate import NEAREST
from plant.structures.modal_structure import ModalStructure


def tail_of(setup: Setup, books: Books) -> dict[str, float] | None:
    """What the modes left out took where they are a damped mode (J), and how many wavelengths at
    the limit the struck point is from an edge; None where they are a spring, or none are."""
    spec = setup.plant
    if not spec.damped_tail:
        return None
    away = setup.wavelengths_to_edge
    return {"lost_j": books.tail_dissipated_j, "wavelengths_to_edge": away, "needed": NEAREST}


def theory_of(setup: Setup) -> dict[str, Any] | None:
    """The theory of the plate, what was asked, and what Kirchhoff's may cost (`KirchhoffError`);
    None for a plate that is not made from its sizes."""
    if isinstance(setup.structure, ModalStructure):
        return None
    found = setup.thin_plate_error
    return {
        "asked": setup.scene.plate.theory,
        "chosen": setup.theory,
        "kirchhoff_error": found._asdict() | {"largest": found.largest},
        "jumps": setup.has_law and setup.actuator.bandwidth_hz is None,
        "why_not_3d": setup.why_not_solid,
    }


def theory_words(found: dict[str, Any]) -> str:
    """Which theory a run took, and why."""
    size = f"Kirchhoff's theory may cost {found['kirchhoff_error']['largest']:.1g}"
    if found["chosen"] == "3d":
        loud = "; a force that jumps has no limit as modes are added: give actuator.bandwidth_hz"
        return f"three dimensions; {size}{loud if found['jumps'] else ''}"
    if found["why_not_3d"]:
        return f"Kirchhoff; {size}, but {found['why_not_3d']}"
    return f"Kirchhoff; {size}, no more than asked"


def tail_words(found: dict[str, float]) -> str:
    """What stands for the modes left out where that is no spring."""
    words, away = (
        f"one damped mode took {found['lost_j'] * 1e6:.3g} uJ",
        found["wavelengths_to_edge"],
    )
    if away >= found["needed"]:
        return words
    return f"{words}; not known so close to an edge, {away:.2g} of {found['needed']:g} wavelengths"


def what_limits(report: dict[str, Any]) -> str:
    """Why a run expects more error than was asked for, in words."""
    if report["theory"] and report["theory"]["chosen"] == "3d":
        return "all that this step, or a contact as wide as the waves, allows"
    if "modes_in_file" in report["struck"]:
        return "all that the file has"
    if report["frequency_limit_hz"] < (1.0 - 1e-9) * report["model"]["full"]["frequency_limit_hz"]:
        return (
            "the law's force is held from sample to sample, and its steps cost that, not the "
            "modes; a smaller run.step_ns or actuator.bandwidth_hz makes them smaller"
        )
    return "all that this step can carry, a smaller run.step_ns carries more"
