"""The plant as a C library: the bytes of the compiled loop, without Python."""

import math
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.exported import build, drive, same_bytes
from hertzloop.closed_loop.parts import series_under
from hertzloop.interop import image as images
from hertzloop.interop.fmu import EXAMPLE
from hertzloop.loop.simulate import simulate
from hertzloop.scene.build import build_plant
from tests.commands import as_options, refused, succeed
from tests.hertzloop.interop.plant_in_c import NOISY, SHORT, InC, exported
from tests.hertzloop.own_laws import needs_cc
from tests.hertzloop.scenes import aluminium_3mm

pytestmark = needs_cc
KINDS = {
    "short": SHORT,
    "noisy": NOISY,
    "sensor elsewhere": (
        *SHORT,
        "controller.law=velocity_feedback",
        "sensors.quantity=v_p",
        "sensors.point_m=[0.31,0.22]",
    ),
}


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return exported(tmp_path_factory.mktemp("short"), aluminium_3mm(*SHORT))


@pytest.fixture
def plant(short):
    plant = InC(short / "libhertzloop_plant.so")
    yield plant
    plant.c.hertzloop_plant_free(plant.plant)


@pytest.mark.full
@pytest.mark.parametrize("kind", KINDS)
def test_a_program_in_c_gets_the_bytes_of_the_loop(kind, tmp_path):
    scene = aluminium_3mm(*KINDS[kind])
    loop = simulate(scene)
    assert np.max(loop.forces) > 1.0  # the law acted
    driven = drive(build(exported(tmp_path, scene)), loop.forces)
    assert same_bytes(loop, driven)
    balance = loop.balance
    for what in (
        "kinetic_j",
        "gravity_j",
        "modal_j",
        "contact_j",
        "injected_j",
        "modal_dissipated_j",
        "contact_dissipated_j",
    ):
        assert driven.energies[what] == getattr(balance, what), what
    assert driven.energies["residual"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.full
def test_the_library_needs_libc_and_libm_only(short):
    library = short / "libhertzloop_plant.so"
    needed = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
    names = {line.split()[0].split("/")[-1].split(".")[0] for line in needed.splitlines()}
    assert names <= {"linux-vdso", "libm", "libc", "ld-linux-x86-64"}
    seen = subprocess.run(["nm", "-D", library], capture_output=True, text=True, check=True).stdout
    given = re.findall(r" T (\w+)", seen)
    assert given
    assert all(name.startswith("hertzloop_plant_") for name in given)
    assert not re.search(r"\bU _?(Py|NRT|numba)", seen)
    assert library.stat().st_size - len(images.image(aluminium_3mm(*SHORT)).data) < 300_000


@pytest.mark.full
def test_the_example_runs(short):
    assert len(EXAMPLE.read_text().splitlines()) <= 40
    program = build(short, short / "main.c")
    said = subprocess.run([program], capture_output=True, text=True, check=True, env={}).stdout
    assert re.fullmatch(r"aluminium-3mm: .* contact force at most \d+\.\d+ N, .*\n", said)


@pytest.mark.full
def test_it_starts_anew_from_another_height(plant):
    """The model stays that of the scene; the sphere falls from elsewhere."""
    scene = aluminium_3mm(*SHORT)
    start = plant.run(np.zeros(1000))
    spec = scene.plant
    higher = replace(spec, sphere=replace(spec.sphere, drop_height_m=0.2))
    rows = series_under(build_plant(scene, higher), np.zeros(1000))
    assert plant.reset(0.2, 5) == 0
    assert plant.run(np.zeros(1000))["contact_force_n"].tobytes() == rows[4].tobytes()
    assert plant.reset(scene.mechanics.sphere.drop_height_m, scene.run.seed) == 0
    assert plant.run(np.zeros(1000)).tobytes() == start.tobytes()


@pytest.mark.full
@pytest.mark.parametrize(
    ("call", "status", "sentence"),
    [
        (lambda p: p.step(math.nan), 1, "the command is nan; a force is a number"),
        (
            lambda p: p.step(0.0, 2001),
            2,
            "the exported run ends at 0.002 s; export a scene with a longer run.duration_s",
        ),
        (lambda p: p.reset(0.0, 1), 1, "a drop height is 1e-7 to 100 m, not 0"),
        (
            lambda p: p.set_state(bytes(p.about.state_bytes)),
            1,
            "the state is not one of this plant",
        ),
    ],
)
def test_bad_use_is_said_and_changes_nothing(plant, call, status, sentence):
    plant.run(np.full(700, 2.0))
    kept = plant.state()
    assert call(plant) == status
    assert plant.said() == sentence
    assert plant.state() == kept


@pytest.mark.full
def test_a_processor_without_the_instructions_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "needed", lambda cpu: ["avx5124fmaps", "sse3"])
    library = exported(tmp_path, aluminium_3mm(*SHORT)) / "libhertzloop_plant.so"
    plant = InC(library)
    assert not plant.plant
    assert plant.c.hertzloop_plant_refused().decode() == (
        "this plant was exported for host and its code needs avx5124fmaps, which this processor "
        "does not have; export it with --cpu x86-64"
    )


@pytest.mark.full
def test_the_command_writes_a_library(tmp_path, short):
    out = tmp_path / "plant.so"
    told = succeed("export-plant", "aluminium-3mm", *as_options(SHORT), "-o", out, "--cpu", "host")
    assert told.startswith(f"written: {out}, for host, ")
    assert out.read_bytes() == (short / "libhertzloop_plant.so").read_bytes()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("aluminium-3mm -o plant.dll", "plant.dll: must end in"),
        ("aluminium-3mm -o there.so", "there.so exists. Choose another name with --out"),
        ("aluminium-3mm --out-dir full", "--out-dir = full: the folder is not empty. Choose"),
        ("thesis-aluminium -o plant.so", "run.scheme = 'thesis2008' cannot be exported"),
        ("aluminium-3mm -o plant.so --cpu host", "there is no C compiler `cc` here"),
    ],
)
def test_bad_input_ends_with_a_sentence(words, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "there.so").touch()
    (tmp_path / "full" / "a").mkdir(parents=True)
    refused(sentence, "export-plant", *words.split())
    assert not (tmp_path / "plant.so").exists()
