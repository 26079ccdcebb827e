"""What a replay shows: decimated curves, spans and moments, the plate as drawn."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.bus.messages_pb2 import ControllerReport, EventKind, RunEnd
from hertzloop.recordings import joined_stream
from hertzloop.recordings.joined_stream import JoinedStream
from hertzloop.recordings.recording import Event, EventData, Recording
from hertzloop.recordings.replay import axis_range, decimation, scene3d
from hertzloop.recordings.replay.contacts import ContactSpan, contact_spans, contacts_of
from hertzloop.recordings.replay.decimation import (
    Decimator,
    enough,
    extremes,
    full_rate_spans,
    within,
)
from hertzloop.recordings.replay.deflection import Deflection
from hertzloop.recordings.replay.law_states import law_states
from hertzloop.recordings.replay.moments import moments
from hertzloop.recordings.replay.plots import Plot, PlotCurve, plots
from hertzloop.recordings.replay.replay_data import samples_at
from tests.recordings.plates import flat_plate

# Thinning and spans


@pytest.mark.parametrize("count", [0, 1, 2, 99, 100, 101, 12_345])
def test_decimation_keeps_ends_and_extremes_of_every_piece(count):
    values = np.random.default_rng(1).normal(size=count)
    kept = extremes(values, 100)
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= 104
    if count:
        assert (kept[0], kept[-1]) == (0, count - 1)
        assert (values[kept].min(), values[kept].max()) == (values.min(), values.max())


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


def test_values_without_bound_are_kept_what_is_constant_is_not():
    values = np.ones(4097)
    assert len(enough(np.arange(4097), values, 0.0, held=False)) == 2
    values[[10, 300, 301, 302]] = np.nan, np.inf, np.inf, -np.inf
    kept = enough(np.arange(4097), values, 1e-3, held=False)
    assert {9, 10, 11, 299, 300, 301, 302, 303} <= set(kept.tolist())


def test_contacts_are_found_up_to_both_ends():
    xi = np.array([-1.0, 0.0, -1.0, -1.0, 1.0, -1.0])
    assert contact_spans(xi) == [(0, 1), (2, 4), (5, 6)]
    assert contact_spans(np.ones(3)) == []
    assert contact_spans(np.empty(0)) == []


def test_a_short_run_is_shown_at_full_rate_a_long_one_around_contacts():
    assert full_rate_spans([(10, 20)], 1000) == [(0, 1000)]
    assert full_rate_spans([], 0) == []
    assert full_rate_spans([], 1_000_000) == []
    spans = full_rate_spans([(1000, 1030), (30_000, 30_030), (900_000, 900_030)], 1_000_000)
    assert spans[0][0] == 0
    assert all(a < b for a, b in spans)
    assert all(one[1] <= other[0] for one, other in itertools.pairwise(spans))
    for start, end in ((1000, 1030), (30_000, 30_030), (900_000, 900_030)):
        assert any(a <= start and end <= b for a, b in spans)
    # However long the contacts are.
    spans = full_rate_spans([(0, 400_000), (500_000, 900_000)], 1_000_000)
    assert sum(b - a for a, b in spans) == decimation.FULL_RATE_SAMPLES


@pytest.mark.parametrize("piece", [7_001, 65_536, 500_000])
def test_a_decimated_line_has_every_sample_of_its_spans_and_every_extreme(piece):
    values = np.random.default_rng(2).normal(size=500_000)
    values[[123_457, 400_001]] = 9.0, -9.0
    decimator = Decimator(len(values))
    for first in range(0, len(values), piece):
        some = values[first : first + piece]
        decimator.feed(first, some, within([(1000, 3000), (8000, 8010)], first, len(some)))
    line = decimator.line()
    assert {*range(1000, 3000), *range(8000, 8010), 123_457, 400_001} <= set(line.at.tolist())
    assert len(line.at) < decimation.OUTSIDE_POINTS + decimation.OVERVIEW_POINTS + 2500
    assert np.all(np.diff(line.at) > 0)
    assert line.values.tobytes() == values[line.at].tobytes()
    overview = line.values[line.overview]
    assert len(overview) < 1.1 * decimation.OVERVIEW_POINTS
    assert (overview.min(), overview.max()) == (-9.0, 9.0)
    assert np.diff(line.at[line.overview]).max() < 500


def test_contacts_are_found_across_the_seams_of_pieces():
    rng = np.random.default_rng(4)
    xi = np.repeat(rng.choice([-1.0, 1.0], 40), 5) * rng.uniform(0.1, 1.0, 200)
    force = np.where(xi < 0.0, rng.uniform(1.0, 2.0, 200), 0.0)
    expected = [ContactSpan(a, b, force[a:b].max(), -xi[a:b].min()) for a, b in contact_spans(xi)]
    for length in (1, 3, 7, 200):
        pieces = [
            (at, {"xi_m": xi[at : at + length], "f_c_n": force[at : at + length]})
            for at in range(0, 200, length)
        ]
        assert contacts_of(pieces) == expected


def test_samples_are_picked_across_the_seams_of_pieces(monkeypatch):
    monkeypatch.setattr(joined_stream, "PIECE", 10)
    values = np.arange(100.0)
    blocks = [{"xi_m": values[at : at + 7]} for at in range(0, 100, 7)]
    again = joined_stream.Columns(lambda: iter(blocks), {"xi_m": values.dtype}, 100)
    stream = JoinedStream(1, step_ns=1000, arrays=again)
    wanted = np.array([0, 9, 10, 13, 14, 99])
    assert samples_at(stream, wanted, ["xi_m"])["xi_m"].tolist() == wanted.tolist()
    assert [at for at, _ in stream.pieces()] == [0, 14, 28, 42, 56, 70, 84, 98]


# What is shown when


def test_play_shows_the_first_contact_and_a_still_lies_shortly_after_it():
    when = moments((0, 99_999_000), (1_000_000, 1_030_000), 1000)
    assert when.selection_ns[0] < 1_000_000 < 1_030_000 < when.selection_ns[1] < 2_000_000
    assert 1_030_000 < when.still_ns < when.selection_ns[1]


@pytest.mark.parametrize("contact", [None, (0, 1), (0, 5), (4, 5)])
@pytest.mark.parametrize("steps", [5, 1])
def test_moments_stay_within_a_run_of_few_steps(contact, steps):
    last_ns = 1000 * (steps - 1)
    if contact is not None:
        contact = 1000 * min(contact[0], steps - 1), 1000 * min(contact[1], steps)
    when = moments((0, last_ns), contact, 1000)
    assert 0 <= when.still_ns <= last_ns
    assert 0 <= when.selection_ns[0] <= last_ns


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
    fields = ("xi_m", "f_c_n", "f_a_n", "v_p_m_s")
    truth = JoinedStream(1, step_ns=1000, arrays={name: np.zeros(4) for name in fields})
    daq = JoinedStream(
        1, step_ns=1000, every_steps=2, scale=0.5, arrays={"code": np.array([1, -3])}
    )
    toml = f"[sensors]\nquantity = '{quantity}'"
    recording = Recording(Path("a.mcap"), scene_toml=toml, truth=truth, daq=daq)
    (found,) = [(p.key, c) for p in plots(recording, []) for c in p.curves if c.name == "measured"]
    assert found[0] == plot
    np.testing.assert_allclose(found[1].values, factor * np.array([0.5, -1.5]))
    assert found[1].time_ns.tolist() == [0, 2000]
    # Only what a run is compared with is faint, and there is no other run.
    assert not any(c.faint for p in plots(recording, []) for c in p.curves)


def test_the_first_contact_is_in_the_zoom_of_a_run_that_ends_in_it():
    run_ns = (0, 19_999_000)
    when = moments(run_ns, (1_000_000, 20_000_000), 1000)
    assert when.still_ns - when.zoom_ns[0] < 1_000_000 < when.still_ns <= run_ns[1]
    assert when.still_ns + when.zoom_ns[1] <= run_ns[1]
    exploding = moments(run_ns, (1_000_000, 3_000_000), 1000, 4_000_000)
    assert exploding.still_ns + exploding.zoom_ns[1] <= 4_001_000
    assert exploding.selection_ns[1] <= 4_000_000


# The plate as drawn


def bent_plate() -> Deflection:
    x, y = np.linspace(0.0, 0.5, 21), np.linspace(0.0, 0.3, 13)
    shape = np.outer(np.sin(np.pi * x / 0.5), np.sin(np.pi * y / 0.3))
    w = np.array([0.0, -1e-5, 1e-5])[:, None, None] * shape
    return Deflection(np.array([0, 1000, 2000]), x, y, w, (0.25, 0.15))


def test_heights_are_drawn_by_a_round_factor_that_makes_them_visible():
    drawn = scene3d.scale(bent_plate(), (0, 2000), 0.003)
    assert drawn.heights == 2000.0  # 1e-5 m to 0.02 m, of a side of 0.3 m
    assert drawn.sphere_radius_m > 0.003
    assert scene3d.scale(flat_plate(np.array([0])), (0, 0), 0.05).heights == 1.0
    # A span in which nothing moves: what comes later counts.
    assert scene3d.scale(bent_plate(), (0, 0), 0.003).heights == 10_000.0


def test_triangles_face_up_and_normals_agree_with_them():
    plate = bent_plate()
    drawn = scene3d.scale(plate, (0, 2000), 0.003)
    corners = scene3d.vertices(plate, drawn)[1][scene3d.triangles(plate)]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(faces) == 2 * 20 * 12
    assert np.all(faces[:, 2] > 0.0)
    assert abs(faces[:, 2].sum() / 2 - 0.5 * 0.3) < 1e-6
    normals = scene3d.normals(plate, drawn)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-6)
    at_first_corner = normals[1][scene3d.triangles(plate)[:, 0]]
    unit = faces / np.linalg.norm(faces, axis=1)[:, None]
    assert np.all((unit * at_first_corner).sum(axis=1) > 0.98)


def test_the_sphere_rests_on_the_plate_in_contact_and_hovers_by_the_same_factor():
    plate = bent_plate()
    drawn = scene3d.scale(plate, (0, 2000), 0.003)
    centres = scene3d.sphere_centres(plate, np.array([3e-5, -1.5e-5, 1e-5]), drawn)
    bottom = centres[:, 2] - drawn.sphere_radius_m
    # Near the plate by the same factor, high above it by less: 0.35 of the side at most.
    squeezed = 0.105 * np.tanh(2000.0 * 3e-5 / 0.105)
    np.testing.assert_allclose(bottom, [squeezed, -0.02, 0.02], rtol=1e-5)
    far = scene3d.sphere_centres(plate, np.array([1.0, 1.0, 1.0]), drawn)
    assert far[:, 2].max() - drawn.sphere_radius_m < 0.105 + 0.02 + 1e-6


_finite = st.floats(allow_nan=False, allow_infinity=False)
_column = st.one_of(
    st.lists(st.floats(), max_size=6),
    st.builds(lambda value, count: [value] * count, _finite, st.integers(1, 4)),
)


@given(
    key=st.sampled_from(["gap", "force"]),
    columns_drawn=st.lists(_column, min_size=1, max_size=2),
    most=st.none() | st.floats(0.0, allow_infinity=False),
    around=st.tuples(st.integers(-2, 8), st.integers(-2, 8)).map(sorted),
)
def test_any_column_has_a_range_to_be_drawn_in(key, columns_drawn, most, around):
    """Empty, constant, of one sample, of huge and of damaged values."""
    curves = tuple(
        PlotCurve("xi", np.arange(len(values)), np.array(values, float)) for values in columns_drawn
    )
    plot = Plot(key, "", curves, most)
    for low, high in (axis_range.whole(plot), axis_range.zoomed(plot, (around[0], around[1]))):
        assert np.isfinite([low, high, high - low]).all()
        assert low < high
