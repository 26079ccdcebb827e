"""The exported plant as a Functional Mock-up Unit for co-simulation, FMI 2.0 or 3.0."""

import hashlib
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop import __version__
from hertzloop.elsewhere.image import Image
from hertzloop.elsewhere.library import LICENCES, C, write_library
from hertzloop.elsewhere.variables import Version, description, header, identifier, variables
from hertzloop.scenes.errors import SceneError

_PLATFORMS: dict[Version, str] = {"2": "linux64", "3": "x86_64-linux"}
_LARGEST: dict[Version, int] = {"2": 2**31, "3": 2**63}
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the same unit is the same file


def write_fmu(image: Image, cpu: str, version: Version, out: Path) -> None:
    """Write the unit. Raises SceneError for a seed that FMI 2.0 has no number for, NoCompiler and
    CompileFault."""
    seed = image.setup.seed
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
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for entry, data in entries.items():
            file.writestr(zipfile.ZipInfo(entry, _LONG_AGO), data, zipfile.ZIP_DEFLATED)


def _token(image: Image, cpu: str, version: Version) -> str:
    """What tells one unit from any other."""
    said = f"{__version__} {cpu} {version} {image.constants} {variables(image)}".encode()
    digest = hashlib.sha256(image.data + said).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20])) + "}"
