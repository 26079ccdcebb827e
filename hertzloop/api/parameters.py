"""Errors that name parameters of Python where the command line has options."""

import re
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")
_OPTION = re.compile(r"--([a-z]+(?:-[a-z]+)*)")
_OTHER_NAMES = {"out": "recording", "law": "laws"}  # of parameters that are not named as options


def with_parameter_names(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function whose errors name its parameters, not options of the command line."""

    @wraps(function)
    def called(*args: _P.args, **named: _P.kwargs) -> _R:
        try:
            return function(*args, **named)
        except Exception as error:
            if hasattr(error, "exit_status") and error.args and isinstance(error.args[0], str):
                error.args = (named_as_parameters(error.args[0]), *error.args[1:])
            raise

    return called


def named_as_parameters(sentences: str) -> str:
    """Return sentences in which `--at-most` is `at_most`; options of a quoted command stay."""

    def parameter(found: re.Match[str]) -> str:
        begins = max(sentences.rfind(". ", 0, found.start()), 0)
        before = sentences[begins : found.start()]
        if "hertzloop " in before or "`" in before:
            return found[0]
        return _OTHER_NAMES.get(found[1], found[1].replace("-", "_"))

    return _OPTION.sub(parameter, sentences)
