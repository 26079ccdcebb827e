"""The replay: what is in the .rrd file, the command, and one picture without a screen."""

import io
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import hertzloop
from hertzloop.loop import in_process
from hertzloop.loop.in_process import record_in_process
from hertzloop.loop.simulate import simulate
from hertzloop.plant.time_series import V_P
from hertzloop.recordings import writer
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording, SampledStream
from hertzloop.recordings.replay import as_rerun, scene3d, viewer
from hertzloop.recordings.replay.replay_data import prepare
from hertzloop.recordings.replay.screenshot import screenshot
from hertzloop.scene.setup import load
from hertzloop.views import replaying
from tests.commands import call, refused, succeed
from tests.recordings.plates import flat_plate

SCENE = ["run.duration_s=0.003"]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A short recording with one contact."""
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    record_in_process(load("aluminium-3mm", SCENE), path, compiled=True)
    return path


def rerun(*words: object) -> str:
    """Output of a command of the viewer's own tool."""
    command = [str(viewer.executable()), *(str(word) for word in words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "ERROR" not in done.stderr
    return done.stdout


def entities(rrd: Path) -> dict[str, int]:
    """Chunks by entity of the data, without those of the dashboard."""
    listed = rerun("rrd", "stats", rrd).split("Num chunks per entity")[1].split("\n\n")[0]
    found = {name: int(count) for name, count in re.findall(r"^(/\S+): (\d+)$", listed, re.M)}
    roots = "scene", "overview", "zoom", "spectrum", "contacts", "events", "states", "about"
    return {name: count for name, count in found.items() if name.split("/")[1] in roots}


ENTITIES = {
    "/about", "/contacts", "/events", "/scene",
    "/scene/edge", "/scene/plate", "/scene/sphere", "/states/contact", "/states/law",
    *(f"/{part}/{curve}" for part in ("overview", "zoom")
      for curve in ("gap/xi", "gap/measured", "force/F_c", "force/F_a", "velocity/v_p")),
}  # fmt: skip
# What the command adds: the actuator, energies, spectra.
FROM_LABELS = {
    "/scene/actuator", "/scene/actuator/name", "/scene/actuator/force",
    "/spectrum/run",
    *(f"/{part}/energy/{curve}" for part in ("overview", "zoom")
      for curve in ("sphere", "plate", "contact", "fed")),
}  # fmt: skip
REFERENCE = {
    "/spectrum/0_no_control",
    # By names that come first, since the viewer draws later ones over them.
    *(
        f"/{part}/{plot}/0_{curve}_reference"
        for part in ("overview", "zoom")
        for plot, curve in (
            ("gap", "xi"),
            ("force", "F_c"),
            ("velocity", "v_p"),
            ("energy", "plate"),
        )
    ),
}


# The .rrd file


def test_the_file_holds_every_entity_and_loads(file, tmp_path):
    rrd = tmp_path / "run.rrd"
    assert f"written: {rrd}" in succeed("replay", file, "--save", rrd)
    rerun("rrd", "verify", rrd)
    # The web viewer shows a layout of its own instead of one that is not active.
    assert "make_active: true" in rerun("rrd", "print", rrd)
    assert set(entities(rrd)) == ENTITIES | FROM_LABELS | REFERENCE
    succeed("replay", file, "--save", rrd, "--alone", "--overwrite")
    assert set(entities(rrd)) == ENTITIES | FROM_LABELS


def test_a_run_lies_over_its_reference_from_the_contact_on(file, tmp_path):
    """The other run falls for longer and is moved to touch at the same time."""
    later = load("aluminium-3mm", [*SCENE, "run.lead_in_s=0.0015", "controller.kappa=0.5"])
    record_in_process(later, tmp_path / "later.mcap", compiled=True)
    shown = replaying.prepare(read(file), read(tmp_path / "later.mcap"))
    curves = {c.name: c for p in shown.plots for c in p.curves if p.key == "gap"}
    begins = [
        int(curve.time_ns[np.argmax(curve.values < 0.0)])
        for curve in (curves["xi"], curves["xi_reference"])
    ]
    assert begins[0] == begins[1]
    assert (curves["xi"].label, curves["xi_reference"].label) == ("xi A", "xi B")
    told = " ".join(shown.labels.lines)
    assert "controller.kappa A 0.8, B 0.5" in told
    assert "B is moved by -0.500 ms" in told


def test_the_reference_without_control_is_the_uncontrolled_run(file):
    free = simulate(load("aluminium-3mm", SCENE).without_control())
    shown = replaying.prepare(read(file))
    curves = {c.name: c for p in shown.plots for c in p.curves}
    assert curves["v_p_reference"].values.tobytes() == free.truth[V_P].tobytes()
    assert shown.labels.lines[0] == hertzloop.read(file).verdict[0]
    assert "Faint: the same without control." in shown.labels.lines
    energies = {c.name: c.values for p in shown.plots if p.key == "energy" for c in p.curves}
    parts = energies["sphere"] + energies["plate"] + energies["contact"] - energies["fed"]
    np.testing.assert_allclose(parts, parts[0], rtol=1e-9)
    assert abs(energies["contact"][-1]) < 1e-3 * parts[0]  # nothing stored, nothing dissipated


def test_an_exploding_loop_is_drawn_by_its_first_contact(tmp_path):
    unstable = load(
        "aluminium-20mm",
        ["controller.law=velocity_feedback", "controller.kappa=0.4", "run.duration_s=0.014"],
    )
    record_in_process(unstable, tmp_path / "a.mcap", compiled=True)
    shown = replaying.prepare(read(tmp_path / "a.mcap"))
    assert shown.labels.lines[0].startswith("UNSTABLE: ")
    assert any(line.startswith("**Unstable** from 7.612 ms") for line in shown.labels.lines)
    assert shown.drawn.heights >= 10.0
    assert np.abs(scene3d.heights(shown.deflection, shown.drawn)).max() <= 0.16
    assert shown.when.still_ns + shown.when.zoom_ns[1] < 7_650_000


def test_times_are_exact_to_the_nanosecond(tmp_path):
    recording = Recording(Path("a.mcap"))
    fields = ("xi_m", "xi_s_m", "f_c_n", "f_a_n", "v_p_m_s")
    arrays = {name: np.ones(3) for name in fields} | {"f_c_n": np.array([0.0, 1.0, 0.0])}
    recording.truth = SampledStream(1, step_ns=333_333_337, arrays=arrays)
    shown = prepare(recording, flat_plate(recording.truth.time_ns))
    as_rerun.save(shown, tmp_path / "a.rrd")
    printed = rerun("rrd", "print", "-vvv", "--entity", "/states/contact", tmp_path / "a.rrd")
    assert re.findall(r"(PT?[\d.]+[SD]) .*\[(apart|in contact)\]", printed) == [
        ("P0D", "apart"),
        ("PT0.333333337S", "in contact"),
        ("PT0.666666674S", "apart"),
    ]


@pytest.mark.parametrize("missing", ["daq", "force", "events", "contact"])
def test_what_is_missing_is_left_out(file, tmp_path, missing):
    recording = read(file)
    if missing == "events":
        recording.events = []
    elif missing == "contact":
        apart = {"f_c_n": 0.0 * recording.truth.arrays["f_c_n"]}
        recording.truth.arrays = dict(recording.truth.arrays) | apart
    else:
        setattr(recording, missing, SampledStream())
    shown = prepare(recording, flat_plate(recording.truth.time_ns[:1]))
    as_rerun.save(shown, tmp_path / "a.rrd")
    rerun("rrd", "verify", tmp_path / "a.rrd")
    gone = {
        "daq": {"/overview/gap/measured", "/zoom/gap/measured"},
        "events": {"/events"},
        "contact": {"/contacts"},
    }.get(missing, set())
    assert set(entities(tmp_path / "a.rrd")) == ENTITIES - gone


# The command


def test_the_users_mistakes(file, tmp_path, monkeypatch):
    taken = tmp_path / "taken.png"
    taken.touch()
    for words, sentence in (
        ([file, "--screenshot", taken], "Choose another name with --screenshot"),
        ([file, file, "--alone"], "--alone: cannot be combined with the recording"),
    ):
        refused(sentence, "replay", *words)
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert "--save" in refused("--screenshot", "replay", file)


def fake_viewer(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    file = folder / "viewer"
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)
    monkeypatch.setattr(viewer, "executable", lambda: file)


def test_a_window_that_is_closed_is_no_error_one_that_breaks_is(tmp_path, monkeypatch):
    fake_viewer(tmp_path, monkeypatch, "exit 0")
    viewer.show(tmp_path / "a.rrd", 0)
    fake_viewer(tmp_path, monkeypatch, "echo 'Error: no window'; exit 3")
    with pytest.raises(viewer.ViewerError, match="ended with code 3; its log ends: Error: no win"):
        viewer.show(tmp_path / "a.rrd", 0)
    fake_viewer(tmp_path, monkeypatch, "echo 'No graphics adapter was found' >&2; exit 101")
    with pytest.raises(viewer.ViewerError, match="mesa-vulkan-drivers libvulkan1"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0)


def test_a_viewer_that_never_answers_is_given_up_and_killed(tmp_path, monkeypatch):
    fake_viewer(tmp_path, monkeypatch, f"echo $$ > {tmp_path}/id; exec sleep 1000")
    with pytest.raises(viewer.ViewerError, match=r"did not draw the picture within 2 s"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0, within_s=2.0)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "id").read_text()), 0)


@pytest.mark.full
def test_a_picture_without_a_screen(file, tmp_path):
    png = tmp_path / "run.png"
    result = call("replay", file, "--screenshot", png)
    if "no graphics driver" in result.output and "CI" not in os.environ:
        pytest.skip("no Vulkan driver here")
    assert result.exit_code == 0, result.output
    with PIL.Image.open(io.BytesIO(png.read_bytes())) as image:
        pixels = np.asarray(image.convert("RGB"), dtype=int)
    assert pixels.shape == (1200, 1920, 3)
    # The plate is the only large bright thing, the curve of the contact force the only red one.
    plate, plots = pixels[50:440, :860], pixels[300:500, 880:1440]
    assert (plate.min(axis=2) > 150).mean() > 0.1
    red, green, blue = plots.transpose(2, 0, 1)
    assert ((red > 180) & (green < 140) & (blue < 140)).sum() > 100


def test_a_replay_ends_where_samples_are_missing(tmp_path, monkeypatch):
    """Later deflections would be made up."""
    monkeypatch.setattr(writer, "_FLUSH_EVERY_S", -1.0)
    monkeypatch.setattr(in_process, "EVERY_S", 0.0)  # a block of truth every 1000 steps
    whole, damaged, rrd = (tmp_path / name for name in ("whole.mcap", "damaged.mcap", "a.rrd"))
    record_in_process(load("aluminium-3mm", SCENE), whole, compiled=True)
    content = bytearray(whole.read_bytes())
    content[len(content) * 2 // 5] ^= 1  # amid the second of three blocks of truth
    damaged.write_bytes(content)
    kept = read(damaged)
    assert 0 < kept.truth.samples < 3000
    succeed("replay", damaged, "--save", rrd)
    rerun("rrd", "verify", rrd)


# A structure from a file of modes


def modes_csv(folder: Path) -> Path:
    """Some modes, without their shapes."""
    path = folder / "modes.csv"
    path.write_text(
        "# residual_flexibility_m_n = 1e-8\n"
        "frequency_hz,loss_factor,modal_mass_kg,shape_contact\n"
        + "".join(f"{200.0 * n**2},1e-3,0.5,{(-1) ** n}\n" for n in range(1, 13))
    )
    return path


BEAM = """
name = "beam"
shows = "modes without shapes"
[sphere]
material = "steel"
radius_m = 0.01
drop_height_m = 0.02
[plate]
material = "steel"
modes = "{modes}"
[controller]
kappa = 0.5
[run]
duration_s = 0.002
"""


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.toml").write_text(BEAM.format(modes=modes_csv(folder).name))
    record_in_process(load(str(folder / "beam.toml")), folder / "beam.mcap", compiled=True)
    return read(folder / "beam.mcap")


def test_what_a_file_of_modes_does_not_say_is_not_drawn(beam, tmp_path):
    shown = replaying.prepare(beam)
    assert not shown.deflection.known
    assert shown.drawn.flat
    # All of it is in sight: as large as the sphere asks for.
    assert max(shown.deflection.size_m) < 30.0 * 0.01
    as_rerun.save(shown, tmp_path / "beam.rrd")
    assert set(entities(tmp_path / "beam.rrd")) == (ENTITIES | FROM_LABELS | REFERENCE)
