"""The command that takes pictures of the replay: every shipped scene, a comparison, an unstable
run."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from hertzloop.commands.options import make_folder
from hertzloop.commands.terminal import fail, out

_UNSTABLE = (
    "controller.law=velocity_feedback", "controller.kappa=0.4", "run.duration_s=0.013",
)  # fmt: skip
_COMPARED = ("aluminium-20mm", ("run.duration_s=0.014",))
_OTHER = ("controller.law=shifted_threshold", "controller.kappa=0.9", "controller.v_thr_m_s=-0.9")


def pictures(
    folder: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for the pictures.", metavar="DIR")
    ],
    only: Annotated[
        list[str] | None, typer.Option("--only", help="A picture by its name; repeat for more.")
    ] = None,
) -> None:
    """Pictures of the replay: every shipped scene over itself without control, two laws compared,
    an unstable run. No screen needed; a quarter of a minute each."""
    from hertzloop.commands import replaying
    from hertzloop.loop.inprocess import record_in_process
    from hertzloop.scenes.scene import load, shipped
    from recordings.reader import read
    from recordings.writer import RecordingError

    wanted: dict[str, list[tuple[str, tuple[str, ...]]]] = {n: [(n, ())] for n in shipped()}
    source, settings = _COMPARED
    wanted["comparison"] = [(source, settings), (source, (*settings, *_OTHER))]
    wanted["unstable"] = [(source, _UNSTABLE)]
    unknown = [name for name in only or [] if name not in wanted]
    if unknown:
        fail(f"there is no picture '{unknown[0]}'; there are {', '.join(wanted)}", 2)
    make_folder(folder)
    for name in only or wanted:
        with TemporaryDirectory(prefix="hertzloop-") as temporary:
            files = []
            for i, (scene, changed) in enumerate(wanted[name]):
                files.append(Path(temporary) / f"{scene}{'-other' * i}.mcap")
                record_in_process(load(scene, changed), files[-1], compiled=True)
            first, *others = (read(file) for file in files)
            try:
                picture = folder / f"replay-{name}.png"
                replaying.replay(first, None, picture, others[0] if others else None)
            except RecordingError as error:
                fail(str(error), 1)
        out.print(f"written: {picture}", soft_wrap=True)
