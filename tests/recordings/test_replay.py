"""The replay: what is thinned, what is in the .rrd file, and one picture without a screen."""

import dataclasses
import io
import itertools
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from typer.testing import CliRunner, Result

from hertzloop.cli import app
from hertzloop.inprocess import record_in_process
from hertzloop.scene import load
from recordings import plate_mesh, replay, replay_data, viewer, writer
from recordings.reader import Event, Recording, Stream, read
from recordings.replay_data import Deflection, contact_spans, extremes, full_rate_spans
from recordings.screenshot import screenshot
from recordings.writer import RecordingError

SCENE = ["run.duration_s=0.003"]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short recording with one contact."""
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    record_in_process(load("aluminium-3mm", SCENE), path, compiled=True)
    return path


def flat_plate(times_ns: np.ndarray) -> Deflection:
    w = np.zeros((len(times_ns), 3, 3))
    axis = np.array([0.0, 0.1, 0.2])
    return Deflection(times_ns, axis, axis, w, (0.1, 0.1))


def call(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "300"})


def rerun(*words: object) -> str:
    """Output of a command of the viewer's own tool."""
    command = [str(viewer.executable()), *(str(word) for word in words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def entities(rrd: Path) -> dict[str, int]:
    """Chunks by entity of the data, without those of the dashboard."""
    listed = rerun("rrd", "stats", rrd).split("Num chunks per entity")[1].split("\n\n")[0]
    found = {name: int(count) for name, count in re.findall(r"^(/\S+): (\d+)$", listed, re.M)}
    roots = ("/scene", "/overview", "/zoom", "/events", "/states", "/about")
    return {name: count for name, count in found.items() if name.startswith(roots)}


ENTITIES = {
    "/about", "/events", "/scene", "/scene/edge", "/scene/plate", "/scene/sphere",
    "/states/contact", "/states/law",
    *(f"/{part}/{curve}" for part in ("overview", "zoom")
      for curve in ("gap/xi", "gap/measured", "force/F_c", "force/F_a", "velocity/v_p")),
}  # fmt: skip


# Thinning and spans


@pytest.mark.parametrize("count", [0, 1, 2, 5, 99, 100, 101, 12_345])
def test_thinning_keeps_ends_and_extremes_of_every_piece(count: int) -> None:
    values = np.random.default_rng(1).normal(size=count)
    kept = extremes(values, 100)
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= 104
    if count:
        assert (kept[0], kept[-1]) == (0, count - 1)
        assert (values[kept].min(), values[kept].max()) == (values.min(), values.max())


def test_thinning_keeps_a_spike_of_one_sample() -> None:
    values = np.zeros(1_000_000)
    values[123_457] = 1.0
    values[876_543] = -1.0
    kept = extremes(values, 6000)
    assert {123_457, 876_543} <= set(kept.tolist())
    assert len(kept) < 6010


def test_contacts_are_found_up_to_both_ends() -> None:
    xi = np.array([-1.0, 0.0, -1.0, -1.0, 1.0, -1.0])
    assert contact_spans(xi) == [(0, 1), (2, 4), (5, 6)]
    assert contact_spans(np.ones(3)) == []
    assert contact_spans(np.empty(0)) == []


def test_a_short_run_is_shown_at_full_rate_a_long_one_around_contacts() -> None:
    assert full_rate_spans([(10, 20)], 1000) == [(0, 1000)]
    assert full_rate_spans([], 0) == []
    assert full_rate_spans([], 1_000_000) == []
    spans = full_rate_spans([(1000, 1030), (30_000, 30_030), (900_000, 900_030)], 1_000_000)
    assert spans[0][0] == 0
    assert all(a < b for a, b in spans)
    assert all(one[1] <= other[0] for one, other in itertools.pairwise(spans))
    for start, end in ((1000, 1030), (30_000, 30_030), (900_000, 900_030)):
        assert any(a <= start and end <= b for a, b in spans)


def test_full_rate_is_limited_however_long_the_contacts_are() -> None:
    spans = full_rate_spans([(0, 400_000), (500_000, 900_000)], 1_000_000)
    assert sum(b - a for a, b in spans) == replay_data.FULL_RATE_SAMPLES


def test_a_zoom_curve_has_every_sample_of_its_spans() -> None:
    values = np.random.default_rng(2).normal(size=500_000)
    chosen = replay_data.zoom_positions(values, [(1000, 3000)])
    assert set(range(1000, 3000)) <= set(chosen.tolist())
    assert len(chosen) < replay_data.OUTSIDE_POINTS + 2100


# What is shown when


def test_play_shows_the_first_contact_and_a_still_lies_shortly_after_it() -> None:
    time_ns = np.arange(100_000) * 1000
    when = replay_data.moments(time_ns, [(1000, 1030), (50_000, 60_000)], 1000)
    assert when.selection_ns[0] < 1_000_000 < 1_030_000 < when.selection_ns[1] < 2_000_000
    assert 1_030_000 < when.still_ns < when.selection_ns[1]


@pytest.mark.parametrize("contacts", [[], [(0, 1)], [(0, 5)], [(4, 5)]])
@pytest.mark.parametrize("steps", [5, 1])
def test_moments_stay_within_a_run_of_few_steps(
    contacts: list[tuple[int, int]], steps: int
) -> None:
    time_ns = np.arange(5)[:steps] * 1000
    contacts = [(min(a, steps - 1), min(b, steps)) for a, b in contacts]
    when = replay_data.moments(time_ns, contacts, 1000)
    assert 0 <= when.still_ns <= time_ns[-1]
    assert 0 <= when.selection_ns[0] <= time_ns[-1]


def test_states_of_the_law_come_from_its_events() -> None:
    events = [
        Event(1_000, "controller", 2, "law idle -> watching"),
        Event(1_500, "plant", 2, "contact 1 began"),
        Event(2_000, "controller", 2, "law watching -> acting, threshold crossed, delay 11 us"),
    ]
    recording = Recording(Path("a.mcap"), events=events)
    assert replay_data.law_states(recording) == [
        (0, "idle"), (1_000, "watching"), (2_000, "acting"),
    ]  # fmt: skip
    off = Recording(Path("a.mcap"), scene_toml="[controller]\nlaw = 'off'")
    assert replay_data.law_states(off) == [(0, "off")]


@pytest.mark.parametrize(
    ("quantity", "plot", "factor"),
    [("xi", "gap", 1e6), ("v_p", "velocity", 1.0), ("acceleration", "acceleration", 1.0),
     ("contact_force", "force", 1.0)],
)  # fmt: skip
def test_what_was_measured_is_plotted_where_it_belongs(
    quantity: str, plot: str, factor: float
) -> None:
    fields = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")
    truth = Stream(1, step_ns=1000, arrays={name: np.zeros(4) for name in fields})
    daq = Stream(1, step_ns=1000, every_steps=2, scale=0.5, arrays={"code": np.array([1, -3])})
    toml = f"[sensors]\nquantity = '{quantity}'"
    recording = Recording(Path("a.mcap"), scene_toml=toml, truth=truth, daq=daq)
    (found,) = [
        (p.key, c) for p in replay_data.plots(recording) for c in p.curves if c.name == "measured"
    ]
    assert found[0] == plot
    np.testing.assert_allclose(found[1].values, factor * np.array([0.5, -1.5]))
    assert found[1].time_ns.tolist() == [0, 2000]


# The plate as drawn


def bent_plate() -> Deflection:
    x, y = np.linspace(0.0, 0.5, 21), np.linspace(0.0, 0.3, 13)
    shape = np.outer(np.sin(np.pi * x / 0.5), np.sin(np.pi * y / 0.3))
    w = np.array([0.0, -1e-5, 1e-5])[:, None, None] * shape
    return Deflection(np.array([0, 1000, 2000]), x, y, w, (0.25, 0.15))


def test_heights_are_drawn_by_a_round_factor_that_makes_them_visible() -> None:
    drawn = plate_mesh.scale(bent_plate(), (0, 2000), 0.003)
    assert drawn.heights == 2000.0  # 1e-5 m to 0.02 m, of a side of 0.3 m
    assert drawn.sphere_radius_m > 0.003
    assert plate_mesh.scale(flat_plate(np.array([0])), (0, 0), 0.05).heights == 1.0
    # A span in which nothing moves: what comes later counts.
    assert plate_mesh.scale(bent_plate(), (0, 0), 0.003).heights == 10_000.0


def test_triangles_face_up_and_normals_agree_with_them() -> None:
    plate = bent_plate()
    drawn = plate_mesh.scale(plate, (0, 2000), 0.003)
    corners = plate_mesh.vertices(plate, drawn)[1][plate_mesh.triangles(plate)]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(faces) == 2 * 20 * 12
    assert np.all(faces[:, 2] > 0.0)
    assert abs(faces[:, 2].sum() / 2 - 0.5 * 0.3) < 1e-6
    normals = plate_mesh.normals(plate, drawn)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-6)
    at_first_corner = normals[1][plate_mesh.triangles(plate)[:, 0]]
    unit = faces / np.linalg.norm(faces, axis=1)[:, None]
    assert np.all((unit * at_first_corner).sum(axis=1) > 0.98)


def test_the_sphere_rests_on_the_plate_in_contact_and_hovers_by_the_same_factor() -> None:
    plate = bent_plate()
    drawn = plate_mesh.scale(plate, (0, 2000), 0.003)
    centres = plate_mesh.sphere_centres(plate, np.array([3e-5, -1.5e-5, 1e-5]), drawn)
    bottom = centres[:, 2] - drawn.sphere_radius_m
    np.testing.assert_allclose(bottom, 2000.0 * np.array([3e-5, -1e-5, 1e-5]), rtol=1e-5)


# The .rrd file


def test_the_file_holds_every_entity_and_loads(file: Path, tmp_path: Path) -> None:
    rrd = tmp_path / "run.rrd"
    result = call("replay", file, "--save", rrd)
    assert result.exit_code == 0, result.output
    assert f"written: {rrd}" in result.output
    rerun("rrd", "verify", rrd)
    assert set(entities(rrd)) == ENTITIES


def test_times_are_exact_to_the_nanosecond(tmp_path: Path) -> None:
    recording = Recording(Path("a.mcap"))
    fields = ("xi_m", "xi_s_m", "f_c_n", "f_a_n", "v_p_m_s")
    arrays = {name: np.ones(3) for name in fields} | {"xi_m": np.array([1.0, -1.0, 1.0])}
    recording.truth = Stream(1, step_ns=333_333_337, arrays=arrays)
    shown = replay.prepare(recording, flat_plate(recording.truth.time_ns))
    replay.save(shown, tmp_path / "a.rrd")
    printed = rerun("rrd", "print", "-vvv", "--entity", "/states/contact", tmp_path / "a.rrd")
    assert re.findall(r"(PT?[\d.]+[SD]) .*\[(apart|in contact)\]", printed) == [
        ("P0D", "apart"), ("PT0.333333337S", "in contact"), ("PT0.666666674S", "apart"),
    ]  # fmt: skip


def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "_FLUSH_EVERY_S", 0.0)
    whole, cut, rrd = (tmp_path / name for name in ("whole.mcap", "cut.mcap", "cut.rrd"))
    record_in_process(load("aluminium-3mm", SCENE), whole, compiled=True)
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    assert 0 < read(cut).truth.samples < read(whole).truth.samples
    result = call("replay", cut, "--save", rrd)
    assert result.exit_code == 0, result.output
    assert "cut off" in result.output
    rerun("rrd", "verify", rrd)


def test_a_recording_without_a_step_says_so(file: Path, tmp_path: Path) -> None:
    recording = dataclasses.replace(read(file), truth=Stream())
    with pytest.raises(RecordingError, match=r"run\.mcap holds no step of the simulation"):
        replay.check_replayable(recording)


@pytest.mark.parametrize("missing", ["daq", "force", "events", "contact"])
def test_what_is_missing_is_left_out(file: Path, tmp_path: Path, missing: str) -> None:
    recording = read(file)
    if missing == "events":
        recording.events = []
    elif missing == "contact":
        recording.truth.arrays["xi_m"] = abs(recording.truth.arrays["xi_m"])
    else:
        setattr(recording, missing, Stream())
    shown = replay.prepare(recording, flat_plate(recording.truth.time_ns[:1]))
    replay.save(shown, tmp_path / "a.rrd")
    rerun("rrd", "verify", tmp_path / "a.rrd")
    gone = {
        "daq": {"/overview/gap/measured", "/zoom/gap/measured"}, "events": {"/events"},
    }.get(missing, set())  # fmt: skip
    assert set(entities(tmp_path / "a.rrd")) == ENTITIES - gone


# The command


def test_the_users_mistakes(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = tmp_path / "taken.png"
    taken.touch()
    for words, sentence in (
        (["none.mcap", "--save", tmp_path / "a.rrd"], "none.mcap"),
        ([file, "--screenshot", taken], "choose another name with --screenshot"),
        ([file, "--save", tmp_path / "nowhere" / "a.rrd"], "nowhere does not exist"),
    ):
        result = call("replay", *words)
        assert (result.exit_code, sentence in result.output) == (2, True), result.output
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = call("replay", file)
    assert result.exit_code == 2
    assert "--screenshot" in result.output
    assert "--save" in result.output


def fake_viewer(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    file = folder / "viewer"
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)
    monkeypatch.setattr(viewer, "executable", lambda: file)


def test_a_window_that_is_closed_is_no_error_one_that_breaks_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_viewer(tmp_path, monkeypatch, "exit 0")
    viewer.show(tmp_path / "a.rrd", 0)
    fake_viewer(tmp_path, monkeypatch, "echo 'Error: no window'; exit 3")
    with pytest.raises(viewer.ViewerError, match="ended with code 3; its log ends: Error: no win"):
        viewer.show(tmp_path / "a.rrd", 0)


def test_a_viewer_that_ends_at_once_is_no_reason_to_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_viewer(tmp_path, monkeypatch, "echo 'No graphics adapter was found' >&2; exit 101")
    with pytest.raises(viewer.ViewerError, match="mesa-vulkan-drivers libvulkan1"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0)


def test_a_viewer_that_never_answers_is_given_up_and_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_viewer(tmp_path, monkeypatch, f"echo $$ > {tmp_path}/id; exec sleep 1000")
    with pytest.raises(viewer.ViewerError, match=r"did not draw the picture within 2 s"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0, within_s=2.0)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "id").read_text()), 0)


def test_a_picture_without_a_screen(file: Path, tmp_path: Path) -> None:
    png = tmp_path / "run.png"
    result = call("replay", file, "--screenshot", png)
    if "no graphics driver" in result.output and "CI" not in os.environ:
        pytest.skip("no Vulkan driver here")
    assert result.exit_code == 0, result.output
    with PIL.Image.open(io.BytesIO(png.read_bytes())) as image:
        pixels = np.asarray(image.convert("RGB"), dtype=int)
    assert pixels.shape == (1000, 1600, 3)
    # The plate is the only large bright thing, the curve of the contact force the only red one.
    plate, plots = pixels[40:600, :720], pixels[260:560, 730:1200]
    assert (plate.min(axis=2) > 150).mean() > 0.1
    red, green, blue = plots.transpose(2, 0, 1)
    assert ((red > 180) & (green < 140) & (blue < 140)).sum() > 100
