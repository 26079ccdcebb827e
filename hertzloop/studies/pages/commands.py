"""The command that runs a case again."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from hertzloop.common.readable import argument
from hertzloop.scene.toml import toml_text


def run_command(
    scene: str, case: Mapping[str, Any], settings: Sequence[str] = (), seed: int | None = None
) -> str:
    """Return the command that runs a case.

    Args:
        scene: Name or file of the scene.
        case: Values of scene keys.
        settings: Other changes of keys, as of --set; the case replaces those of its keys.
        seed: Random seed, unless the case has its own; None: that of the scene.
    """
    others = [text for text in settings if text.partition("=")[0].strip() not in case]
    changes = [*others, *(f"{key}={toml_text(value)}" for key, value in case.items())]
    words = [word for change in changes for word in ("--set", change)]
    seeded = [] if seed is None or "run.seed" in case else ["--seed", str(seed)]
    return shlex.join(["hertzloop", "run", argument(scene), *words, *seeded])
