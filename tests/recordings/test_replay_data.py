"""What a replay shows: decimated curves, spans and moments, the plate as drawn, what is sent."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import ControllerReport, EventKind, RunEnd, TruthBlock
from hertzloop.recordings.recording import Event, EventData, Recording, SampledStream
from hertzloop.recordings.replay import decimation, live, scene3d, spectrum
from hertzloop.recordings.replay.decimation import decimated, enough
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.law_states import law_states
from hertzloop.recordings.replay.plots import plots

# Thinning and spans


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("count", [1, 2, 3, 64, 65, 1000])
def test_a_curve_of_fewer_samples_keeps_within_its_error(count, held):
    """At uneven times, too; what is smooth takes few samples, a jump none more."""
    rng = np.random.default_rng(count)
    time_ns = np.cumsum(rng.integers(1, 9, count))
    values = np.sin(time_ns / 700.0) + (np.arange(count) > count // 3)
    kept = enough(time_ns, values, 1e-2, held)
    assert (kept[0], kept[-1]) == (0, count - 1)
    if held:
        shown = values[kept][np.searchsorted(kept, np.arange(count), "right") - 1]
    else:
        shown = np.interp(time_ns, time_ns[kept], values[kept])
    assert abs(shown - values).max() <= 1e-2 * (1 + 1e-9)
    if count == 1000:
        assert len(kept) < (800 if held else 200)


def test_a_decimated_line_has_every_sample_around_contacts_and_every_extreme():
    values = np.random.default_rng(2).normal(size=500_000)
    values[[123_457, 400_001]] = 9.0, -9.0
    line = decimated(values, [(1000, 3000), (8000, 8010)])
    assert {*range(1000, 3000), *range(8000, 8010), 123_457, 400_001} <= set(line.at.tolist())
    most = decimation.OUTSIDE_POINTS + decimation.OVERVIEW_POINTS + decimation.FULL_RATE_SAMPLES
    assert len(line.at) < most
    assert np.all(np.diff(line.at) > 0)
    assert line.values.tobytes() == values[line.at].tobytes()
    overview = line.values[line.overview]
    assert len(overview) < 1.1 * decimation.OVERVIEW_POINTS
    assert (overview.min(), overview.max()) == (-9.0, 9.0)
    assert np.diff(line.at[line.overview]).max() < 500


# What is shown when


def test_states_of_the_law_come_from_its_events():
    events = [
        Event(1_000, "controller", 2, "...", EventData(EventKind.LAW_MODE, mode_before=0, mode=1)),
        Event(1_500, "plant", 2, "...", EventData(EventKind.CONTACT_BEGAN, 1)),
        Event(2_000, "controller", 2, "...", EventData(EventKind.LAW_MODE, mode_before=1, mode=2)),
    ]
    recording = Recording(Path("a.mcap"), events=events)
    assert law_states(recording) == [
        (0, "idle"),
        (1_000, "watching"),
        (2_000, "acting"),
    ]
    off = Recording(Path("a.mcap"), scene_toml="[controller]\nlaw = 'off'")
    assert law_states(off, controlled=False) == [(0, "off")]
    foreign = dataclasses.replace(
        off, ends={"controller": RunEnd(report=ControllerReport(law="another's"))}
    )
    assert law_states(foreign) == [(0, "not told")]


@pytest.mark.parametrize(
    ("quantity", "plot", "factor"),
    [
        ("xi", "gap", 1e6),
        ("v_p", "velocity", 1.0),
        ("acceleration", "acceleration", 1.0),
        ("contact_force", "force", 1.0),
    ],
)
def test_what_was_measured_is_plotted_where_it_belongs(quantity, plot, factor):
    daq = SampledStream(
        1, step_ns=1000, every_steps=2, scale=0.5, arrays={"code": np.array([1, -3])}
    )
    toml = f"[sensors]\nquantity = '{quantity}'"
    recording = Recording(Path("a.mcap"), toml, truth=truth_of_zeros(4), daq=daq)
    (found,) = [(p.key, c) for p in plots(recording, []) for c in p.curves if c.name == "measured"]
    assert found[0] == plot
    np.testing.assert_allclose(found[1].values, factor * np.array([0.5, -1.5]))
    assert found[1].time_ns.tolist() == [0, 2000]
    # Only what a run is compared with is faint, and there is no other run.
    assert not any(c.faint for p in plots(recording, []) for c in p.curves)


# What is handed to the viewer

STEP_S = 1e-6
FIELDS = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")


class Drawn:
    """Stands for a recording of the viewer: keeps what is sent, by entity."""

    def __init__(self) -> None:
        self.logged: dict[str, Any] = {}
        self.columns: dict[str, tuple[list[int], list[Any]]] = {}

    def log(self, path: str, what: object, static: bool) -> None:
        assert static
        self.logged[path] = what

    def send_columns(self, path: str, indexes: list[Any], columns: Any) -> None:
        [times], [column] = indexes, columns
        times_ns = times.as_arrow_array().cast("int64").to_pylist()
        self.columns[path] = times_ns, column.as_arrow_array().to_pylist()

    def part(self, path: str, name: str) -> list[Any]:
        """A component of an entity."""
        found: list[Any] = getattr(self.logged[path], name).as_arrow_array().to_pylist()
        return found


def test_a_sine_peaks_at_the_bar_of_its_frequency():
    t, frequencies_hz = STEP_S * np.arange(1 << 16), (1e3, 1e4)
    shown: Any = Drawn()
    spectra = [
        spectrum.spectrum(f"{f:g} Hz", np.sin(2.0 * np.pi * f * t), STEP_S) for f in frequencies_hz
    ]
    spectrum.send(shown, spectra, [(1, 2, 3)] * 2)
    for name, frequency_hz in (("1000_Hz", 1e3), ("0_10000_Hz", 1e4)):
        bars = shown.logged[f"spectrum/{name}"]
        at, level = (
            np.array(part.as_arrow_array().to_pylist()[0]["buffer"])
            for part in (bars.abscissa, bars.values)
        )
        assert at[level.argmax()] == pytest.approx(np.log10(frequency_hz), abs=0.03)
        assert level.min() >= 0.0


def test_a_live_view_shows_a_block_at_its_time_and_in_its_unit():
    gap = np.array([3e-6, -2e-6, 1e-6])
    rest = {name: np.zeros(3) for name in FIELDS[1:]}
    shown: Any = Drawn()
    block = TruthBlock(first_step=1000, step_ns=500)
    sent = live.send_block(shown, codec.encode(block, xi_m=gap, **rest))
    times, values = shown.columns["live/gap/xi"]
    assert times == [500_000, 500_500, 501_000]
    np.testing.assert_allclose(np.ravel(values), [3.0, -2.0, 1.0])
    assert sent == sum(len(times) for times, _ in shown.columns.values())


def truth_of_zeros(count: int, **more: np.ndarray) -> SampledStream:
    arrays = {name: np.zeros(count) for name in FIELDS}
    return SampledStream(1, step_ns=1000, arrays=arrays | more)


def test_the_actuators_force_is_an_arrow_to_scale_at_its_point():
    x, y = np.linspace(0.0, 0.5, 6), np.linspace(0.0, 0.3, 4)
    plate = Deflection(np.arange(4), x, y, np.zeros((4, 6, 4)), (0.25, 0.15))
    drawn = scene3d.scale(plate, (0, 3), 0.003)
    shown: Any = Drawn()
    force_n = np.array([0.0, 10.0, -5.0, np.nan])
    scene3d.send_actuator(shown, force_n, plate, (0.2, 0.1), drawn, 20.0)
    ring = np.array(shown.part("scene/actuator", "strips")[0])
    np.testing.assert_allclose(ring[:-1, :2].mean(axis=0), (0.2, 0.1), atol=1e-6)
    away = np.hypot(*(ring[:, :2] - (0.2, 0.1)).T)
    np.testing.assert_allclose(away, 1.5 * drawn.sphere_radius_m, rtol=1e-5)
    assert shown.part("scene/actuator/name", "labels") == ["actuator, full arrow 20 N"]
    arrows = np.array(shown.columns["scene/actuator/force"][1])[:, 0]
    np.testing.assert_allclose(arrows[:, :2], 0.0)
    # A full one is 0.16 of the shorter side; up is away from the plate.
    np.testing.assert_allclose(
        arrows[:, 2], 0.16 * 0.3 * np.array([0.0, 0.5, -0.25, 0.0]), rtol=1e-5
    )
