"""The files that the command `fit` writes."""

from dataclasses import dataclass
from pathlib import Path

from hertzloop.cli import outputs
from hertzloop.cli.terminal import out
from hertzloop.common.atomic_files import atomic_write
from hertzloop.common.text_files import text_of
from hertzloop.fitting.fit.reports.fit_json import as_json
from hertzloop.fitting.fit.reports.fitted_scene import fitted_scene
from hertzloop.fitting.fit.results import FitResult


@dataclass(frozen=True)
class FitFiles:
    """The files of a fit; None for one that is not wanted.

    Attributes:
        scene: the fitted scene.
        picture: measured over simulated values.
        json: the file of --json, or standard output.
    """

    scene: Path | None
    picture: Path | None
    json: Path | None

    def check(self, read: list[Path], overwrite: bool, named: bool) -> None:
        """End the command unless all files can be written.

        Args:
            read: files that the command reads.
            overwrite: whether existing files may be replaced.
            named: whether the user names the fitted scene. Without a name, an earlier fitted scene
                is replaced.
        """
        if self.scene is not None:
            own = not named and _written_by_fit(self.scene)
            outputs.check_output(self.scene, overwrite or own, read=read)
        if self.picture is not None:
            outputs.check_picture(self.picture)
            outputs.check_output(self.picture, overwrite, "--picture", read=read)
        outputs.check_json(self.json, self.scene, self.picture)

    def write(self, result: FitResult) -> None:
        """Write the files, the fitted scene only if the records identify its keys."""
        data = as_json(result)
        if self.scene is not None and result.setup is not None and result.identifiable:
            atomic_write(self.scene, fitted_scene(result, self.scene.stem))
            data["scene"] = str(self.scene)
            out.say(f"written: {self.scene}")
        if self.picture is not None:
            from hertzloop.fitting.fit.reports.fit_picture import write_picture  # of an extra

            write_picture(result, self.picture)
            out.say(f"written: {self.picture}")
        outputs.write_json(self.json, data)


def _written_by_fit(path: Path) -> bool:
    """Whether a file is a fitted scene, which may be replaced without asking."""
    try:
        return "\n[fit]\n" in text_of(path.read_bytes())
    except (OSError, ValueError):
        return False
