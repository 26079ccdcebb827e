"""A live view: plots of the whole run until now, of a few samples in every block."""

import rerun as rr
import rerun.blueprint as rrb

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.recordings.replay.decimation import extremes
from hertzloop.recordings.replay.plots import SIGNALS, TITLES
from hertzloop.recordings.replay.scene3d import times

_PIECES = 4  # of a block at least, each with its minimum and maximum
_PIECE_STEPS = 250  # at most


def live_blueprint() -> rrb.Blueprint:
    """A plot for each of the recorded signals."""
    plots = dict.fromkeys(plot for plot, *_ in SIGNALS)
    views = [rrb.TimeSeriesView(origin=f"live/{key}", name=TITLES[key]) for key in plots]
    return rrb.Blueprint(rrb.Vertical(*views), auto_layout=False, auto_views=False)


def send_block(stream: rr.RecordingStream, payload: bytes) -> int:
    """Show some samples of a block of truth; how many. Raises codec.MessageError."""
    block = codec.decode(TruthBlock, payload)
    sent = 0
    for plot, name, field, factor, _ in SIGNALS:
        values = block.arrays[field]
        if not len(values):
            continue
        chosen = extremes(values, 2 * max(_PIECES, -(-len(values) // _PIECE_STEPS)))
        at = times((block.header.first_step + chosen) * block.header.step_ns)
        columns = rr.Scalars.columns(scalars=factor * values[chosen])
        stream.send_columns(f"live/{plot}/{name}", [at], columns)
        sent += len(chosen)
    return sent
