"""The command `bench`."""

from hertzloop.cli.options import SceneArgument
from hertzloop.scenes.scene import DEFAULT


def bench(scene: SceneArgument = DEFAULT) -> None:
    """Measure how fast this computer runs a scene."""
