"""A run while it goes on: a few points of every thousand steps, in a Rerun viewer."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from bus import wire
from bus.messages_pb2 import TruthBlock
from recordings.replay.blueprint import TIMELINE

# Field of a block, entity, factor: the plots of a live view.
_CURVES = (
    ("xi_m", "live/gap/xi", 1e6), ("f_c_n", "live/force/F_c", 1.0),
    ("f_a_n", "live/force/F_a", 1.0), ("v_p_m_s", "live/velocity/v_p", 1.0),
)  # fmt: skip
_PIECES = 4  # of a block at least, each with its minimum and maximum
_PIECE_STEPS = 250  # at most


def blueprint() -> rrb.Blueprint:
    """Three plots of the whole run until now."""
    views = [
        rrb.TimeSeriesView(origin=f"live/{key}", name=title)
        for key, title in (
            ("gap", "Gap xi (µm)"),
            ("force", "Contact F_c, actuator F_a (N)"),
            ("velocity", "Plate velocity v_p (m/s)"),
        )
    ]
    return rrb.Blueprint(rrb.Vertical(*views), auto_layout=False, auto_views=False)


def extremes_of(values: np.ndarray) -> np.ndarray:
    """Ascending positions of the minimum and maximum of each piece of a block."""
    pieces = min(max(_PIECES, -(-len(values) // _PIECE_STEPS)), len(values))
    found = [
        part[0] + np.array([values[part].argmin(), values[part].argmax()])
        for part in np.array_split(np.arange(len(values)), pieces)
    ]
    return np.unique(np.concatenate(found))


def send(stream: rr.RecordingStream, payload: bytes) -> int:
    """Show some samples of a block of truth; how many. Raises wire.MessageError."""
    block = wire.decode(TruthBlock, payload)
    sent = 0
    for field, entity, factor in _CURVES:
        values = block.arrays[field]
        if not len(values):
            continue
        chosen = extremes_of(values)
        times = (block.header.first_step + chosen) * block.header.step_ns
        stream.send_columns(
            entity,
            [rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))],
            rr.Scalars.columns(scalars=factor * values[chosen]),
        )
        sent += len(chosen)
    return sent
