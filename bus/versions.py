"""Which version another side is of, where that is another one: for sentences that refuse it."""

import json
from importlib.metadata import version

_LONGEST = 20  # characters: it comes from elsewhere


def other_version(versions: str, who: str) -> str:
    """Both versions, in brackets, of the `versions` in a hello or a recording (JSON by package);
    empty where they are of this version, or say nothing."""
    try:
        said = json.loads(versions)["hertzloop"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ""
    here = version("hertzloop")
    if not isinstance(said, str) or said == here:
        return ""
    shown = "".join(c for c in said if c.isprintable())[:_LONGEST]
    return f" ({who} hertzloop {shown}, this is {here})"
