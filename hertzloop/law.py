"""What a law's file imports: `from hertzloop.law import Keys, About, kernel`.

See docs/how-to/laws.md.
"""

from pydantic import Field

from hertzloop.controller.law import (
    ACTING,
    IDLE,
    NO_PROMISE,
    SPENT,
    WATCHING,
    About,
    Force,
    Gain,
    Keys,
    LawError,
    Reach,
    StepsUs,
    kernel,
)

__all__ = [
    "ACTING", "IDLE", "NO_PROMISE", "SPENT", "WATCHING", "About", "Field", "Force", "Gain", "Keys",
    "LawError", "Reach", "StepsUs", "kernel",
]  # fmt: skip
