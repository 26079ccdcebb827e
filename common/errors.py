"""The error of a scene that cannot be simulated."""


class SceneError(ValueError):
    """The scene cannot be simulated. The message names the key, its value and the remedy."""

    exit_status = 2
