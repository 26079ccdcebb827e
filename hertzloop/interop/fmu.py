"""The exported plant as a Functional Mock-up Unit (FMI 2.0 or 3.0) and as a C library."""

import hashlib
import re
import shutil
import subprocess
import zipfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np

from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.version import __version__
from hertzloop.interop.image import Image
from hertzloop.interop.object_code import outline
from hertzloop.interop.objects import plant_object
from hertzloop.scene.errors import SceneError
from hertzloop.scene.quantities import SENSED

Version = Literal["2", "3"]
_BASE_UNITS = {
    "s": {"s": 1},
    "m": {"m": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "m/s": {"m": 1, "s": -1},
    "m/s^2": {"m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
}


@dataclass(frozen=True)
class Variable:
    """One variable: its name, unit ("" for whole numbers and ratios), meaning, what it is for, and
    what it starts at, where the master may set it."""

    name: str
    unit: str
    meaning: str
    causality: Literal["independent", "input", "parameter", "output"] = "output"
    whole: bool = False
    start: float | int | None = None

    @property
    def constant(self) -> str:
        """Its value reference in C; see unit.c."""
        short = {"force_command": "COMMAND", "energy_residual": "RESIDUAL"}
        return "V_" + short.get(self.name, self.name.removesuffix("_energy").upper())


def variables(image: Image) -> list[Variable]:
    """All variables in the order of their value references, the time first."""
    setup = image.setup
    unit, meaning = SENSED[setup.scene.sensors.quantity][:2]
    so_far = "so far"
    return [
        Variable("time", "s", "simulated time", "independent"),
        Variable("force_command", "N", "commanded actuator force, up positive, held over the step",
                 "input", start=0.0),
        Variable("drop_height", "m", "height of the drop; modes, damping and the converter's "
                 "range stay those of the scene", "parameter",
                 start=setup.mechanics.sphere.drop_height_m),
        Variable("noise_seed", "", "seed of the sensor's noise and of a random touch phase",
                 "parameter", whole=True, start=setup.run.seed),
        Variable("sample", unit, f"latest {meaning}, as read"),
        Variable("sample_code", "", "code of the converter, 0 of an ideal one", whole=True),
        Variable("sample_clipped", "", "1 if the sample was out of range, else 0", whole=True),
        Variable("gap", "m", "gap between sphere and plate, negative in contact"),
        Variable("sphere_height", "m", "height of the sphere above the plate at rest"),
        Variable("plate_deflection", "m", "deflection of the contact point, up positive"),
        Variable("plate_velocity", "m/s", "velocity of the contact point, end of the step, "
                                          "up positive"),
        Variable("contact_force", "N", "mean over the last step, up on the sphere"),
        Variable("actuator_force", "N", "mean over the last step, up on the plate"),
        Variable("kinetic_energy", "J", "of the sphere"),
        Variable("gravity_energy", "J", "of the sphere above the plate at rest"),
        Variable("modal_energy", "J", "in the plate"),
        Variable("contact_energy", "J", "stored in the contact"),
        Variable("injected_energy", "J", f"given by the actuator, {so_far}"),
        Variable("modal_lost_energy", "J", f"lost in the plate, {so_far}"),
        Variable("contact_lost_energy", "J", f"lost in the contact, {so_far}"),
        Variable("plastic_lost_energy", "J", f"lost by yielding, {so_far}"),
        Variable("energy_residual", "", "relative residual of the energy balance"),
    ]  # fmt: skip


def header(image: Image, token: str) -> str:
    """The text of variables.h."""
    names = ", ".join(variable.constant for variable in variables(image))
    return f'/* Generated. */\n#define UNIT_TOKEN "{token}"\nenum {{ {names} }};\n'


def identifier(image: Image) -> str:
    """Name of the unit's library, a word in C."""
    return "hertzloop_" + re.sub("[^A-Za-z0-9]", "_", image.setup.scene.name)


def description(image: Image, version: Version, token: str, cpu: str) -> bytes:
    """modelDescription.xml."""
    setup, name = image.setup, identifier(image)
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{version}.0",
            "modelName": setup.scene.name,
            "guid" if version == "2" else "instantiationToken": token,
            "description": setup.scene.shows or "a sphere strikes a plate",
            "generationTool": f"hertzloop {__version__}, for {cpu}",
            "variableNamingConvention": "flat",
        },
    )
    state = "FMUstate" if version == "2" else "FMUState"
    if version == "2":
        root.set("numberOfEventIndicators", "0")
    ET.SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": name,
            "canHandleVariableCommunicationStepSize": "true",
            f"canGetAndSet{state}": "true",
            f"canSerialize{state}": "true",
            **({"fixedInternalStepSize": f"{setup.run.step_s:.12g}"} if version == "3" else {}),
        },
    )
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(variable.unit for variable in variables(image) if variable.unit):
        powers = {base: str(power) for base, power in _BASE_UNITS[unit].items()}
        ET.SubElement(ET.SubElement(units, "Unit", name=unit), "BaseUnit", powers)
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatusDiscard", "logStatusError"):
        ET.SubElement(categories, "Category", name=category)
    ET.SubElement(
        root,
        "DefaultExperiment",
        {
            "startTime": "0",
            "stopTime": f"{setup.run.steps * setup.run.step_s:.12g}",
            "stepSize": f"{setup.run.step_s * setup.sensor.every_steps:.12g}",
        },
    )
    _add_variables(root, variables(image), version)
    ET.indent(root)
    return bytes(ET.tostring(root, "utf-8", xml_declaration=True)) + b"\n"


def _add_variables(root: ET.Element, every: list[Variable], version: Version) -> None:
    listed = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(every):
        attributes = {
            "name": variable.name,
            "valueReference": str(reference),
            "causality": variable.causality,
            "description": variable.meaning,
        }
        if variable.causality == "parameter":
            attributes["variability"] = "fixed"
        elif variable.whole:
            attributes["variability"] = "discrete"
        typed = {"unit": variable.unit} if variable.unit else {}
        if variable.start is not None:
            typed["start"] = repr(variable.start)
        if version == "2":
            scalar = ET.SubElement(listed, "ScalarVariable", attributes)
            ET.SubElement(scalar, "Integer" if variable.whole else "Real", typed)
        else:
            ET.SubElement(listed, "Int64" if variable.whole else "Float64", attributes | typed)
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [(r, v) for r, v in enumerate(every) if v.causality == "output"]
    if version == "3":
        for tag in ("Output", "InitialUnknown"):
            for reference, _ in outputs:
                ET.SubElement(structure, tag, valueReference=str(reference), dependencies="")
        return
    for tag in ("Outputs", "InitialUnknowns"):
        group = ET.SubElement(structure, tag)
        for reference, _ in outputs:  # counted from 1
            ET.SubElement(group, "Unknown", index=str(reference + 1), dependencies="")


_PLATFORMS: dict[Version, str] = {"2": "linux64", "3": "x86_64-linux"}
_LARGEST: dict[Version, int] = {"2": 2**31, "3": 2**63}
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the same unit is the same file


def write_fmu(image: Image, cpu: str, version: Version, out: Path) -> None:
    """Write the unit. Raises SceneError for a seed that FMI 2.0 has no number for, NoCompiler,
    CompileFault and NotWritten."""
    seed = image.setup.run.seed
    if seed >= _LARGEST[version]:
        raise SceneError(
            f"run.seed = {seed} is too large for FMI 2.0, whose whole numbers end at 2147483647; "
            "take a smaller one, or FMI 3.0"
        )
    token = _token(image, cpu, version)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "variables.h").write_text(header(image, token), encoding="utf-8")
        more = (C / "unit.c", C / f"fmi{version}.c")
        write_library(image, cpu, folder / "unit.so", more, folder)
        entries = {
            "modelDescription.xml": description(image, version, token, cpu),
            "documentation/licenses/license.txt": LICENCES.read_bytes(),
            f"binaries/{_PLATFORMS[version]}/{identifier(image)}.so": (
                folder / "unit.so"
            ).read_bytes(),
        }
    with zipfile.ZipFile(packed := BytesIO(), "w") as file:
        for entry, data in entries.items():
            file.writestr(zipfile.ZipInfo(entry, _LONG_AGO), data, zipfile.ZIP_DEFLATED)
    atomic_write(out, packed.getvalue())


def _token(image: Image, cpu: str, version: Version) -> str:
    """What tells one unit from any other."""
    inputs = f"{__version__} {cpu} {version} {image.constants} {variables(image)}".encode()
    digest = hashlib.sha256(image.data + inputs).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20])) + "}"


C = Path(__file__).resolve().parent / "c"
HEADER, EXAMPLE, LICENCES = C / "hertzloop_plant.h", C / "main.c", C / "licences.txt"
_SOURCES = ("plant.c", "noise.c")
_NORMAL = Path(np.__file__).parent / "random" / "lib" / "libnpyrandom.a"  # NumPy's, in C
# Rounding as written: a product and a sum stay two operations.
_FLAGS = ("-std=gnu11", "-O2", "-fPIC", "-ffp-contract=off", "-fvisibility=hidden", "-Wall")
_LINK = ("-shared", "-s", "-Wl,--gc-sections", "-Wl,--exclude-libs,ALL", "-Wl,-z,defs")


class NoCompiler(RuntimeError):
    """There is no C compiler, or it refused."""

    exit_status = 2


def write_library(
    image: Image, cpu: str, out: Path, more: tuple[Path, ...] = (), headers: Path = C
) -> None:
    """Write the shared library of a plant, with `more` sources in C that use it, and `headers` of
    theirs. Raises NoCompiler, NotWritten, and CompileFault of `objects`."""
    if shutil.which("cc") is None:
        raise NoCompiler("there is no C compiler `cc` here; on Debian `apt install gcc libc6-dev`")
    if not _NORMAL.exists():
        raise NoCompiler(f"this NumPy comes without {_NORMAL.name}; install it by pip")
    kernels = plant_object(outline(image.unit), cpu)
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "image.bin").write_bytes(image.data)
        (folder / "image.h").write_text(image.header(cpu), encoding="utf-8")
        (folder / "kernels.o").write_bytes(kernels)
        sources = [C / source for source in _SOURCES] + list(more)
        include = [f"-I{path}" for path in (folder, C, headers)]
        parts: list[str | Path] = [*sources, "kernels.o", _NORMAL, "-lm"]
        command: list[str | Path] = ["cc", *_FLAGS, *include, *_LINK, "-o", "made.so", *parts]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            reason = next(iter(done.stderr.strip().splitlines()), "no reason given")
            raise NoCompiler(f"cc did not make the library: {reason}")
        atomic_write(out, (folder / "made.so").read_bytes())


def write_folder(image: Image, cpu: str, folder: Path) -> None:
    """Write library, header, example and licences into an existing folder. Raises as
    `write_library`."""
    write_library(image, cpu, folder / "libhertzloop_plant.so")
    for source in (HEADER, EXAMPLE, LICENCES):
        atomic_write(folder / source.name, source.read_bytes())


# hertzloop_values and hertzloop_energies of hertzloop_plant.h.
VALUES = np.dtype(
    [
        ("step", "i8"),
        ("samples", "i8"),
        ("sample", "f8"),
        ("code", "i8"),
        ("clipped", "i8"),
        ("gap_m", "f8"),
        ("sphere_height_m", "f8"),
        ("plate_deflection_m", "f8"),
        ("plate_velocity_m_s", "f8"),
        ("contact_force_n", "f8"),
        ("actuator_force_n", "f8"),
    ]
)


ENERGIES = (
    "kinetic_j",
    "gravity_j",
    "modal_j",
    "contact_j",
    "injected_j",
    "modal_dissipated_j",
    "contact_dissipated_j",
    "plastic_dissipated_j",
    "residual",
)
