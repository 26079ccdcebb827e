"""Which theory and which tail of a plate a run took, as data and in words."""

from typing import Any

from bus.messages_pb2 import Books
from hertzloop import assembly as parts
from hertzloop.plate_choice import NEAREST, kirchhoff_error, theory, wavelengths_to_edge
from hertzloop.scenes.problems import not_in_three_dimensions
from hertzloop.scenes.scene import Scene


def tail_of(scene: Scene, books: Books) -> dict[str, float] | None:
    """What the modes left out took where they are a damped mode (J), and how many wavelengths at
    the limit the struck point is from an edge; None where they are a spring, or none are."""
    spec = parts.plant_spec(scene)
    if not spec.damped_tail:
        return None
    away = wavelengths_to_edge(scene, spec.plate, spec.frequency_limit_hz)
    return {"lost_j": books.tail_dissipated_j, "wavelengths_to_edge": away, "needed": NEAREST}


def theory_of(scene: Scene) -> dict[str, Any] | None:
    """The theory of the plate, what was asked, and what Kirchhoff's may cost (`KirchhoffError`);
    None for a plate that is not made from its sizes."""
    if scene.plate.modes is not None:
        return None
    found = kirchhoff_error(scene)
    return {
        "asked": scene.plate.theory,
        "chosen": theory(scene),
        "kirchhoff_error": found._asdict() | {"largest": found.largest},
        "jumps": scene.controller.law != "off" and scene.actuator.bandwidth_hz is None,
        "why_not_3d": next(iter(not_in_three_dimensions(scene)), None),
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
