"""What a replay shows: decimated curves, spans and moments, the plate as drawn, what is sent."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from hertzloop.bus.messages_pb2 import ControllerReport, EventKind, RunEnd
from hertzloop.recordings.recording import Event, EventData, Recording, SampledStream
from hertzloop.recordings.replay import decimation
from hertzloop.recordings.replay.decimation import decimated, enough
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

FIELDS = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")


def truth_of_zeros(count: int, **more: np.ndarray) -> SampledStream:
    arrays = {name: np.zeros(count) for name in FIELDS}
    return SampledStream(1, step_ns=1000, arrays=arrays | more)
