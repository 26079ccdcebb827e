"""Replay of a recording: a file for the Rerun viewer, a picture, or a window."""

import tempfile
from pathlib import Path

from hertzloop.deflection import deflection
from hertzloop.scene import parse
from recordings import replay as rerun_replay
from recordings import viewer
from recordings.reader import Recording
from recordings.screenshot import screenshot as draw

has_display = viewer.has_display


def replay(recording: Recording, save: Path | None, screenshot: Path | None) -> None:
    """Write `save` (.rrd) and `screenshot` (.png); with neither, open a window and wait for it.

    Raises SceneError if the recorded scene cannot be read, RecordingError if there is nothing
    to replay, a file cannot be written or the viewer fails.
    """
    rerun_replay.check_replayable(recording)
    plate = deflection(parse(recording.scene_toml), recording)
    if save is not None:
        rerun_replay.save(recording, plate, save)
    if save is not None and screenshot is None:
        return
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        shown = Path(folder) / f"{recording.path.stem}.rrd"
        rerun_replay.save(recording, plate, shown, still=screenshot is not None)
        if screenshot is None:
            viewer.show(shown)
        else:
            draw(shown, screenshot, rerun_replay.moments(recording).still_ns)
