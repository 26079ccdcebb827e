"""Errors that name parameters of Python where the command line has options."""

import re
from collections.abc import Callable
from functools import wraps
from inspect import Parameter, signature
from typing import ParamSpec, TypeVar

from hertzloop.loop.run_options import USES, RunOptions

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


def with_run_options(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function whose signature and docstring list the options of a run for Python."""
    fields = {name: RunOptions.model_fields[name] for name, use in USES.items() if use.python}
    own = signature(function)
    *first, _ = own.parameters.values()  # the last one takes any keyword
    listed = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=getattr(one.default, "value", one.default),
            annotation=one.annotation,
        )
        for name, one in fields.items()
    ]
    allowed = own.replace(parameters=[*first, *listed])

    @wraps(function)
    def called(*args: _P.args, **named: _P.kwargs) -> _R:
        allowed.bind(*args, **named)  # a TypeError for an unknown keyword
        return function(*args, **named)

    words = "".join(f"        {name}: {one.description}\n" for name, one in fields.items())
    begin, args, rest = (function.__doc__ or "").partition("\n\n    Returns:")
    called.__doc__ = f"{begin}\n{words.rstrip()}{args}{rest}"
    called.__signature__ = allowed  # type: ignore[attr-defined]
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
