"""What makes a module or a class a law: its functions, and their arguments."""

from typing import Any

from hertzloop.common.uncompiled import plain
from hertzloop.controller.law import Keys, LawError
from hertzloop.controller.loading.compiled import FUNCTIONS, arguments_of


def check_home(name: str, home: Any) -> None:
    """Whether a module or class holds a law. Raises LawError."""
    for function in FUNCTIONS:
        found = getattr(home, function, None)
        if found is None and function != "command":
            continue
        signature = f"{function}({arguments_of(function)})"
        if not callable(found):
            raise LawError(f"{name}: is not a law; the function {signature} is missing. Add it.")
        code = getattr(plain(found), "__code__", None)
        if code is None or code.co_argcount != signature.count(",") + 1:
            raise LawError(f"{name}: {function} has the wrong arguments. Define it as {signature}.")
    if hasattr(home, "known_ahead") != hasattr(home, "command_ahead"):
        raise LawError(
            f"{name}: defines only one of known_ahead and command_ahead. Define both or none."
        )
    keys = getattr(home, "Parameters", Keys)
    if not (isinstance(keys, type) and issubclass(keys, Keys)):
        raise LawError(f"{name}: Parameters must be a class derived from hertzloop.law.Keys.")
