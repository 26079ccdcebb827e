"""A scene: what is simulated, checked before anything runs."""

import re
import unicodedata
from typing import Annotated, Any

from pydantic import Field, ValidationInfo, field_validator, model_validator

from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find
from hertzloop.scene.controller_table import DEFAULT_LAW, ControllerTable, is_recorded, without_law
from hertzloop.scene.errors import shown
from hertzloop.scene.materials import check_materials
from hertzloop.scene.mechanics import PlantTables
from hertzloop.scene.quantities import SENSED
from hertzloop.scene.rules import problem_of
from hertzloop.scene.tables import (
    ActuatorTable,
    ContactTable,
    FitTable,
    MaterialTable,
    PlateTable,
    RunTable,
    SceneTable,
    SensorsTable,
    SphereTable,
)
from hertzloop.scene.toml import to_toml

_LONGEST = 80  # letters of a name
_NAME = re.compile(r"[^\W_][\w.-]*")


def possible_name(text: str) -> str:
    """Return a name that a scene may have, like the text."""
    plain = re.sub(r"[^\w.-]+", "-", unicodedata.normalize("NFC", text))
    return plain.strip("-_.")[:_LONGEST] or "mine"


class Scene(SceneTable):
    """A scene: one table per part, as in the TOML file. `load` and `vary` make it.

    `scene.controller.latency_us` reads a key. The page of scene keys lists all of them.
    """

    name: Annotated[str, Field(max_length=_LONGEST)]
    """of the scene, and of its recording: letters, digits, ".", "_" and "-"; first a letter or a
    digit"""
    shows: str = ""
    """what it is for, in a sentence"""
    materials: tuple[MaterialTable, ...] | None = None  # by name, beside those that come with it
    """a file of materials, or a list, beside those that come with it"""
    sphere: SphereTable
    plate: PlateTable
    contact: ContactTable = ContactTable()
    sensors: SensorsTable = SensorsTable()
    controller: ControllerTable = ControllerTable()
    actuator: ActuatorTable = ActuatorTable()
    run: RunTable
    fit: FitTable | None = None
    """where fitted values come from"""

    @field_validator("name")
    @classmethod
    def _file_name(cls, value: str) -> str:
        name = unicodedata.normalize("NFC", value)
        if not _NAME.fullmatch(name):
            raise ValueError(
                f"name = {shown(value)}: must begin with a letter or a digit, and have letters, "
                f"digits, '.', '_' and '-' only. Use '{possible_name(value)}'."
            )
        return name

    @property
    def plant_tables(self) -> PlantTables:
        """The tables that make the plant."""
        return PlantTables(
            self.sphere,
            self.plate,
            self.contact,
            self.actuator,
            self.materials,
            self.sensors.point_m,
        )

    def __str__(self) -> str:
        """The scene as TOML, without the contents of the files that it names."""
        return to_toml(self, brief=True)

    def without_control(self) -> "Scene":
        """The same scene with the law switched off."""
        return self.replaced(controller=without_law(self.controller))

    @model_validator(mode="before")
    @classmethod
    def _name_the_quantity(cls, data: Any) -> Any:
        """Put what the law works on in the place of sensors.quantity = "auto"."""
        if not isinstance(data, dict):
            return data
        sensors, control = data.get("sensors", {}), data.get("controller", {})
        if not isinstance(sensors, dict) or not isinstance(control, dict):
            return data
        if sensors.get("quantity", "auto") != "auto":
            return data
        try:
            senses = find(str(control.get("law", DEFAULT_LAW)), control.get("law_digest")).senses
        except LawError:  # the table of the controller says so
            senses = "xi"
        senses = senses.partition(",")[0]  # the default of several
        if senses not in (*SENSED, "any"):  # `_senses_unknown` of the rules refuses it
            senses = "xi"
        return {**data, "sensors": {**sensors, "quantity": senses.replace("any", "xi")}}

    @model_validator(mode="before")
    @classmethod
    def _materials_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            check_materials(data)
        return data

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> "Scene":
        if not is_recorded(info) and (problem := problem_of(self)):
            raise ValueError(problem)
        return self
