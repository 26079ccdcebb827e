"""Names that the file of a law imports, for example `from hertzloop.law import Keys, kernel`.

`IDLE`, `WATCHING`, `ACTING` and `SPENT` are values of `s.mode`. `NO_TRIGGER` is the quiet level of
a law that makes no promise. `StepsUs` (us, a whole number of steps), `Gain` (-100 to 100) and
`Force` (N, at most 1e6) are types of scene keys, and `Field` is that of pydantic.
docs/how-to/laws.md explains the functions of a law.
"""

from pydantic import Field

from hertzloop.controller.law import (
    ACTING,
    IDLE,
    NO_TRIGGER,
    SPENT,
    WATCHING,
    Force,
    ForceBound,
    Gain,
    Keys,
    LawContext,
    LawError,
    Response,
    StepsUs,
    kernel,
)

__all__ = [
    "ACTING",
    "IDLE",
    "NO_TRIGGER",
    "SPENT",
    "WATCHING",
    "Field",
    "Force",
    "ForceBound",
    "Gain",
    "Keys",
    "LawContext",
    "LawError",
    "Response",
    "StepsUs",
    "kernel",
]
