"""What a replay and a live view hand to the viewer: places, times, what is hidden."""

from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.recordings.joined_stream import JoinedStream
from hertzloop.recordings.recording import Recording
from hertzloop.recordings.replay import live, spectrum
from hertzloop.recordings.replay.contacts import ContactSpan
from hertzloop.recordings.replay.plots import LATE, plots

STEP_S = 1e-6
WIDTH, HEIGHT = 100.0, 28.0  # of the drawing of spectra, whose view is cut for it


class SentData:
    """Stands for a recording of the viewer: keeps what is sent, by entity."""

    def __init__(self) -> None:
        self.logged: dict[str, Any] = {}
        self.columns: dict[str, tuple[list[int], list[float]]] = {}

    def log(self, path: str, what: object, static: bool) -> None:
        assert static
        self.logged[path] = what

    def send_columns(self, path: str, indexes: list[Any], values: Any) -> None:
        [times], [scalars] = indexes, list(values)
        times_ns = times.as_arrow_array().cast("int64").to_pylist()
        numbers = [one for [one] in scalars.as_arrow_array().to_pylist()]
        self.columns[path] = times_ns, numbers


def lines(what: Any) -> list[np.ndarray]:
    return [np.array(strip) for strip in what.strips.as_arrow_array().to_pylist()]


def drawn(*frequencies_hz: float) -> SentData:
    """Spectra of sines, as drawn."""
    t = STEP_S * np.arange(1 << 16)
    found = [
        spectrum.spectrum(f"{f:g} Hz", np.sin(2.0 * np.pi * f * t), STEP_S) for f in frequencies_hz
    ]
    shown = SentData()
    spectrum.send(shown, found, [(1, 2, 3)] * len(found))
    return shown


def test_a_sine_peaks_at_the_line_of_its_frequency():
    shown = drawn(1e3, 1e4)
    axes = shown.logged["spectrum/axes"]
    where = np.array(axes.positions.as_arrow_array().to_pylist())
    names = axes.labels.as_arrow_array().to_pylist()
    decades = {name: at for name, (at, _) in zip(names, where, strict=True) if "Hz" in name}
    assert set(decades) == {"100 Hz", "1 kHz", "10 kHz", "100 kHz"}
    band = WIDTH / len(lines(shown.logged["spectrum/line_0"])[0])
    for number, name in enumerate(("1 kHz", "10 kHz")):
        [line] = lines(shown.logged[f"spectrum/line_{number}"])
        assert line[:, 0].min() >= -1e-3
        assert line[:, 0].max() <= WIDTH + 1e-3
        assert line[:, 1].min() >= -1e-3  # up is small: the peak is the smallest
        assert line[:, 1].max() <= HEIGHT + 1e-3
        assert abs(line[line[:, 1].argmin(), 0] - decades[name]) < 2.0 * band


def test_a_live_view_shows_a_block_at_its_time_and_in_its_unit():
    gap = np.array([3e-6, -2e-6, 1e-6])
    rest = {name: np.zeros(3) for name in ("f_c_n", "f_a_n", "v_p_m_s")}
    block = TruthBlock(first_step=1000, step_ns=500)
    shown = SentData()
    sent = live.send_block(shown, codec.encode(block, xi_m=gap, **rest))
    times, values = shown.columns["live/gap/xi"]
    assert times == [500_000, 500_500, 501_000]
    np.testing.assert_allclose(values, [3.0, -2.0, 1.0])
    assert sent == sum(len(times) for times, _ in shown.columns.values())


def test_what_was_measured_of_a_contact_after_a_hole_is_shown_in_full():
    """Samples are missing before it: its own are not where they would be otherwise."""
    count, hole, contact = 600_000, 50_000, ContactSpan(400_000, 400_400, 1.0, 1e-6)
    values = np.random.default_rng(1).normal(size=count // 2 - hole // 2)
    fields = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")
    recording = Recording(
        Path("a.mcap"),
        truth=JoinedStream(1, step_ns=1000, arrays={name: np.zeros(count) for name in fields}),
        daq=JoinedStream(
            1, step_ns=1000, every_steps=2, arrays={"value": values}, resumed=[(1000, 2000 + hole)]
        ),
    )
    [curve] = [
        curve
        for plot in plots(recording, [contact])
        for curve in plot.curves
        if curve.name == "measured"
    ]
    within = np.arange(contact.first, contact.end, 2) * 1000
    assert set(within.tolist()) <= set(curve.time_ns.tolist())


def test_a_run_without_late_forces_has_no_plot_of_them():
    fields = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")
    arrays = {name: np.zeros(4) for name in fields}
    for late in (False, True):
        more = {LATE[2]: np.ones(4)} if late else {}
        truth = JoinedStream(1, step_ns=1000, arrays=arrays | more)
        keys = {plot.key for plot in plots(Recording(Path("a"), truth=truth), [])}
        assert ("late" in keys) == late
