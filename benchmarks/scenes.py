"""The scenes of the benchmarks: elastic copies of the shipped ones."""

from collections.abc import Iterable
from pathlib import Path

from hertzloop.scene import loading, setup
from hertzloop.scene.setup import Setup

FOLDER = Path(__file__).resolve().parent.parent / "tests" / "scenes" / "shipped"


def load(source: str, settings: Iterable[str] = ()) -> Setup:
    """Load a scene with settings; for the name of a shipped scene its elastic copy. Raises
    SceneError."""
    copy = FOLDER / f"{source}.toml"
    return setup.load(str(copy) if source in loading.shipped() else source, settings)
