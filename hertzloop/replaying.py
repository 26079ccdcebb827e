"""Replay of a recording: a file for the Rerun viewer, a picture, or a window."""

import tempfile
from pathlib import Path

from hertzloop.deflection import deflection
from hertzloop.scene import SceneError, parse
from recordings import replay as rerun_replay
from recordings import viewer
from recordings.reader import Recording
from recordings.screenshot import screenshot
from recordings.writer import RecordingError

has_display = viewer.has_display


def replay(recording: Recording, save: Path | None, picture: Path | None) -> None:
    """Write `save` (.rrd) and `picture` (.png); with neither, open a window and wait for it.

    Raises RecordingError if there is nothing to replay, the scene inside cannot be read, a
    file cannot be written or the viewer fails.
    """
    rerun_replay.check_replayable(recording)
    try:
        plate = deflection(parse(recording.scene_toml), recording)
    except SceneError as error:
        raise RecordingError(f"the scene in {recording.path} cannot be read: {error}") from error
    shown = rerun_replay.prepare(recording, plate)
    if save is not None:
        rerun_replay.save(shown, save)
    if save is not None and picture is None:
        return
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        rrd = Path(folder) / f"{recording.path.stem}.rrd"
        rerun_replay.save(shown, rrd, still=picture is not None)
        if picture is None:
            viewer.show(rrd, shown.when.selection_ns[0])
        else:
            screenshot(rrd, picture, shown.when.still_ns)
