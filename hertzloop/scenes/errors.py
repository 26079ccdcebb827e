"""The error of everything that cannot be simulated."""


class SceneError(ValueError):
    """The scene cannot be simulated. The message names the key, its value and the remedy."""


NO_CASE_OF_THESIS = (
    "run.scheme = 'thesis2008' has figures of its own; take 'modal' or 'discrete_gradient'"
)
