"""What has to be compiled follows from the types of a scene's parts."""

import os

import pytest

from hertzloop import warmup
from hertzloop.cli import prepare
from hertzloop.scene.setup import Setup
from tests.hertzloop.commands import python
from tests.hertzloop.scenes import aluminium_3mm

COARSE = ["run.duration_s=0.0025", "run.accuracy=0.1"]
# Kernels are compiled for each of these schemes, whatever the plant.
SCHEMES = {"modal": [], "published": ["run.scheme=thesis2008"]}
PLANTS = (
    ["plate.edges=cccc", "actuator.bandwidth_hz=5e4", "actuator.mass_kg=0.002"],
    ["plate.tail=spring"],
    ["contact.plasticity=thornton"],
    ["run.plate_model=infinite"],
    ["sensors.bits=10"],
    ["controller.law=off"],
    ["plate.thickness_m=0.004"],
)


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """The scenes that were run to compile their kernels, from an empty folder on."""
    found: list[Setup] = []
    monkeypatch.setattr(warmup, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(warmup, "_run_all", found.append)
    return found


def test_a_scheme_is_compiled_once_for_all_plants(ran):
    assert not warmup.anything_compiled()
    for settings in SCHEMES.values():
        scene = aluminium_3mm(*COARSE, *settings)
        assert list(warmup.not_compiled(scene, scene).values()) == [scene]
        warmup.ensure_compiled(scene)
        assert not warmup.not_compiled(scene)
    assert warmup.anything_compiled()
    for more in PLANTS:
        assert not warmup.not_compiled(aluminium_3mm(*COARSE, *more))
    assert [one.scene.controller.law for one in ran] == ["off"] * len(SCHEMES)
    assert all(one.run.duration_s < 0.0025 for one in ran)


def test_each_compilation_says_what_is_compiled(ran, monkeypatch):
    told: list[str] = []
    monkeypatch.setattr(prepare, "announce_compilation", told.append)
    for _ in range(2):
        prepare.compile_first(aluminium_3mm(*COARSE))
    prepare.compile_first(aluminium_3mm(*COARSE, *SCHEMES["published"]))
    assert [words.split(":")[0] for words in told] == [
        "the model",
        "for this kind of scene",
    ]


SCRIPT = """
import sys
from pathlib import Path
from hertzloop.warmup import ensure_compiled
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import load
from hertzloop.scene.controller import build_controller
from hertzloop.common.jit.progress import report_functions

# An infinite plate of which the full model is too large to be timed: little to compile.
scene = load("aluminium-3mm", ["run.plate_model=infinite", "plate.size_m=[3.0, 3.0]",
    "plate.contact_point_m=[1.5, 1.5]", "run.duration_s=0.0012", "run.accuracy=0.1"])
ensure_compiled(scene)
build_controller(scene)  # its law
told = []
with report_functions(told.append):
    for transport in (Transport.COMPILED, Transport.INPROCESS):
        path = Path(sys.argv[1]) / f"{transport}.mcap"
        run_and_assess(scene, path, RunOptions(transport=transport))
print(told)
"""


@pytest.mark.full
def test_a_run_of_a_compiled_scene_compiles_nothing(tmp_path):
    """From an empty cache."""
    (tmp_path / "cache").mkdir()
    cache = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert python("-c", SCRIPT, tmp_path, env=cache).stdout.split() == ["[]"]


LEAN = """
import sys
from hertzloop.results.metrics import free_metrics
from hertzloop.loop.simulate import simulate
from hertzloop.scene.setup import load
setup = load("aluminium-20mm", ["run.duration_s=0.003"])
assert simulate(setup).truth.any()
assert free_metrics(setup).impacts
late = ("scipy.integrate", "scipy.optimize", "scipy.special")
print([name for name in late if name in sys.modules])
"""


@pytest.mark.usefixtures("warm_kernels")
def test_a_run_does_not_load_what_only_studies_need():
    """It would take a fifth of a second."""
    assert python("-c", LEAN).stdout.strip() == "[]"
