"""From a checked scene to what is struck: a plate by its edges, or anything by its modes."""

from functools import lru_cache

from hertzloop.plate_choice import theory, thin_plate
from hertzloop.scenes.files import unpacked
from hertzloop.scenes.scene import Scene, SceneError
from plant.structures.edged_plate import EdgedPlate
from plant.structures.materials import Material
from plant.structures.modal_structure import ModalStructure
from plant.structures.mode_file import read_modes
from plant.structures.plate import Plate
from plant.structures.solid_plate import SolidPlate
from plant.structures.structure import Structure


def structure(scene: Scene) -> Structure:
    """What is struck. Raises SceneError where a file of modes does not make one."""
    table, material = scene.plate, scene.material("plate")
    modes = table.modes
    if modes is not None:
        try:
            return _modal(
                modes.file, modes.sha256, modes.content, material, table.thickness_m,
                table.residual_flexibility_m_n,
            )  # fmt: skip
        except ValueError as error:
            raise SceneError(str(error)) from error
    plate = thin_plate(scene)
    if table.edges in (None, "ssss"):
        return SolidPlate(plate) if theory(scene) == "3d" else plate
    return EdgedPlate(plate, table.edges, scene.run.accuracy)


@lru_cache(maxsize=16)
def _modal(
    file: str, sha256: str, content: str, material: Material,
    thickness_m: float | None, residual: float | None,
) -> ModalStructure:  # fmt: skip
    """One structure for all runs of the same modes."""
    local = None
    if thickness_m is not None:
        local = Plate(material, (1.0, 1.0), thickness_m)  # its size is in the modes
    return ModalStructure(
        file, read_modes(file, unpacked(file, sha256, content)), material, local, residual
    )


def impedance_n_s_m(plate: Structure) -> float:
    """Point impedance 8 sqrt(B' m'') of the plate that a contact feels first. Raises SceneError."""
    if plate.local_plate is None:
        raise SceneError(
            f"what controller.law or sensors.full_scale asks for, the impedance of an infinite "
            f"plate, is not known for {plate}; give plate.thickness_m if it is a plate where it is "
            "struck, or another law, and a range in numbers"
        )
    return plate.local_plate.infinite_plate_impedance_n_s_m
