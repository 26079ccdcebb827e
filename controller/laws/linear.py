"""A digital filter: numerator and denominator, second-order sections, or a file with one."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from hertzloop.common.missing_files import why_unreadable
from hertzloop.controller.law import ACTING, IDLE, Keys, LawContext, LawError, Response

senses = "v_p, acceleration, xi, contact_force"  # the first is the default

_MOST_STATES = 256
_OUTSIDE = 1e-7  # beyond the unit circle; roots of a polynomial are no more accurate

Coefficient = Annotated[float, Field(ge=-1e15, le=1e15)]
Section = tuple[Coefficient, ...]


class Parameters(Keys):
    """Scene keys."""

    gain: float = Field(1.0, ge=-1e9, le=1e9, description="factor on the filter")
    numerator: tuple[Coefficient, ...] = Field(
        (), description="coefficients of 1, 1/z, 1/z^2, ...; N per unit of the samples"
    )
    denominator: tuple[Coefficient, ...] = Field(
        (1.0,), description="coefficients of 1, 1/z, 1/z^2, ..."
    )
    sections: tuple[Section, ...] = Field(
        (), description="second-order sections b0, b1, b2, a0, a1, a2, in place of numerator"
    )
    filter_file: str = Field(
        "", description="file with the filter (.npz); the scene keeps its numbers"
    )
    designed_us: float = Field(
        0.0, ge=0.0, le=1e6, description="sampling interval of the design; 0 if unknown"
    )

    @model_validator(mode="after")
    def _is_a_filter(self) -> Self:
        if self.sections and (self.numerator or self.denominator != (1.0,)):
            raise ValueError(
                "controller.sections: cannot stand beside controller.numerator or "
                "controller.denominator. Leave one of them out."
            )
        if not self.sections and not self.numerator:
            raise ValueError(
                "controller.numerator is empty; law 'linear' needs a filter. Give "
                "controller.numerator, controller.sections or controller.filter_file."
            )
        if not self.denominator or self.denominator[0] == 0.0:
            raise ValueError(
                f"controller.denominator = {list(self.denominator)[:4]}: the first coefficient "
                "must not be zero. It belongs to the sample of now; divide by it."
            )
        for i, row in enumerate(self.sections):
            if len(row) != 6:
                raise ValueError(
                    f"controller.sections: section {i} has {len(row)} numbers. Give six: b0, b1, "
                    "b2, a0, a1, a2."
                )
            if row[3] == 0.0:
                raise ValueError(
                    f"controller.sections: the coefficient a0 of section {i} is zero. Divide each "
                    "section by its a0."
                )
        states = sum(len(b) - 1 for b, _ in stages(self))
        if states > _MOST_STATES:
            raise ValueError(
                f"controller.{'sections' if self.sections else 'numerator'}: needs {states} "
                f"stored numbers; the limit is {_MOST_STATES}. Use a filter of lower order."
            )
        return self


class State:
    """What the law remembers: `memory` of each stage, in the transposed direct form II."""

    mode: int = IDLE
    delay: int = 0
    memory: tuple[float, ...] = (0.0,) * _MOST_STATES


class Constants(NamedTuple):
    """What the compiled function knows: `b` and `a`, order + 1 coefficients a stage."""

    stages: int
    order: int
    b: np.ndarray
    a: np.ndarray


def stages(keys: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return numerator and denominator of each stage, both of one length, without the gain."""
    if keys.sections:
        rows = np.array(keys.sections)
        return [(row[:3] / row[3], row[3:] / row[3]) for row in rows]
    count = max(len(keys.numerator), len(keys.denominator))
    b, a = np.zeros(count), np.zeros(count)
    b[: len(keys.numerator)] = keys.numerator
    a[: len(keys.denominator)] = keys.denominator
    return [(b / a[0], a / a[0])]


def poles(keys: Any) -> np.ndarray:
    """Return the poles of the filter in z, those at zero too, shape (n,)."""
    return np.concatenate([roots(a) for _, a in stages(keys)])


def roots(coefficients: np.ndarray) -> np.ndarray:
    """Return the zeros of a polynomial, the highest power first, shape (n,), complex.

    Newton's method in extended precision removes most of the error of the eigenvalues.
    """
    found = np.roots(coefficients).astype(complex)
    exact = np.asarray(coefficients, np.longdouble)
    slope = np.polyder(exact)
    better = found.astype(np.clongdouble)
    for _ in range(4):
        down = np.polyval(slope, better)
        step = np.polyval(exact, better) / np.where(down == 0.0, 1.0, down)
        better = better - np.where(np.abs(step) < 1e-3, step, 0.0)
    return np.asarray(better, complex)


def note(keys: Any) -> str:
    """Return a sentence on a filter that is unstable by itself; empty for any other."""
    found = poles(keys)
    outside = found[np.abs(found) > 1.0 + _OUTSIDE]
    if not len(outside):
        return ""
    return (
        f"The filter of law 'linear' is unstable by itself: poles outside the unit circle: "
        f"{len(outside)}; largest magnitude {np.abs(outside).max():.6g}. Only a loop around it "
        "can keep its force bounded."
    )


def prepare(keys, about: LawContext) -> Constants:
    """Constants of the function; the gain is part of the last stage. Raises LawError."""
    if keys.designed_us and abs(keys.designed_us - 1e6 * about.sample_s) > 1e-6 * keys.designed_us:
        raise LawError(
            f"controller.designed_us = {keys.designed_us:g}: the filter was designed for another "
            f"sampling interval than the scene's {1e6 * about.sample_s:g} us. Design it again, or "
            "change sensors.every_steps."
        )
    parts = stages(keys)
    b, a = np.array([b for b, _ in parts]), np.array([a for _, a in parts])
    b[-1] *= keys.gain
    return Constants(len(parts), b.shape[1] - 1, b.ravel(), a.ravel())


def transfer_function(keys, p) -> Response:
    """The stages, with the gain apart."""
    return Response(keys.gain, stages=tuple(stages(keys)))


def tune(about: LawContext) -> dict[str, tuple[float, float]]:
    """Ranges that `tune` searches."""
    return {"gain": (0.0, 2.0)}


def command(p, s, samples, i):
    """Force of sample `i`, N."""
    value = samples[i]
    for stage in range(p.stages):
        c, m = stage * (p.order + 1), stage * p.order
        out = p.b[c] * value
        if p.order > 0 and s.memory[m] != 0.0:  # without, a zero keeps its sign
            out = out + s.memory[m]
        for j in range(1, p.order):
            s.memory[m + j - 1] = p.b[c + j] * value - p.a[c + j] * out + s.memory[m + j]
        if p.order > 0:
            s.memory[m + p.order - 1] = p.b[c + p.order] * value - p.a[c + p.order] * out
        value = out
    if value != 0.0:
        s.mode = ACTING
    return value


# A file names its arrays as scipy.signal and python-control do: `sos`; `b` and `a`, by powers of
# 1/z; `num` and `den`, by powers of z, the highest first; `A`, `B`, `C`, `D` of a state space. `dt`
# is the sampling interval, s: 0 of a continuous filter; True, None or a negative number if it is
# unknown.

_FORMS = (("sos",), ("b", "a"), ("num", "den"), ("A", "B", "C", "D"))
_FORMS_IN_WORDS = "the array sos, or b and a, or num and den, or A, B, C and D"
_ROUNDING = 1e-12  # of the terms of a sum that is zero
_SAME = 1e-6  # of the largest response: difference of the sections from the state space


def read_files(keys: dict[str, Any], folder: Path) -> None:
    """Put the numbers of `filter_file` among the keys of a scene, in its place.

    Args:
        keys: of the table [controller], changed in place.
        folder: what a relative path starts from.

    Raises:
        ValueError: the file holds no filter; one sentence.
    """
    name = keys.get("filter_file")
    if not isinstance(name, str) or not name:
        return
    where = f"controller.filter_file = '{name[-80:]}'"
    arrays, designed_us = _read(folder / name, where)
    for key in ("numerator", "denominator", "sections", "filter_file"):
        keys.pop(key, None)  # left by an earlier file, or a default that a recording wrote out
    keys["designed_us"] = designed_us
    if "sos" in arrays:
        rows = np.atleast_2d(arrays["sos"])
        if rows.ndim != 2 or rows.shape[1] != 6:
            raise ValueError(f"{where}: 'sos' has shape {rows.shape}. Give n rows of 6 numbers.")
        keys["sections"] = rows.tolist()
        return
    if "A" in arrays:
        keys["sections"] = _sections(arrays, where).tolist()
        return
    top, bottom = (np.atleast_1d(np.squeeze(value)) for value in arrays.values())
    for part, value in zip(arrays, (top, bottom), strict=True):
        if value.ndim > 1:
            raise ValueError(
                f"{where}: '{part}' has shape {value.shape}, as of several outputs. Save the one "
                "filter from the samples to the force."
            )
    if "num" in arrays:
        top, bottom = np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f")
        late = len(bottom) - len(top)
        if late < 0 or not len(top):
            raise ValueError(
                f"{where}: 'num' has {len(top)} coefficients and 'den' {len(bottom)}. A filter "
                "that can run has at most as many in 'num'."
            )
        top = np.concatenate([np.zeros(late), top])
    keys["numerator"], keys["denominator"] = top.tolist(), bottom.tolist()


def _read(path: Path, where: str) -> tuple[dict[str, np.ndarray], float]:
    """The arrays of the one filter in a file, by name, and its sampling interval, us; 0 if that is
    unknown. Raises ValueError."""
    if path.suffix != ".npz":
        raise ValueError(f"{where}: unknown format. Use a file that ends in .npz.")
    try:
        with np.load(path, allow_pickle=False) as file:
            forms = [form for form in _FORMS if set(form) <= set(file.files)]
            if len(forms) != 1 or {"c", "d"} <= set(file.files):
                held = "more than one filter" if forms else "no filter"
                raise ValueError(f"holds {held}. Save {_FORMS_IN_WORDS}")
            arrays = {part: _numbers(part, file[part]) for part in forms[0]}
            return arrays, _designed_us(file)
    except OSError as error:
        why = why_unreadable(path, error, "Give the path of a filter.")
        raise ValueError(f"{where}: cannot be read: {why}") from error
    except ValueError as error:
        raise ValueError(f"{where}: {str(error)[:160].removesuffix('.')}.") from error
    except Exception as error:  # zipfile raises whatever it meets
        raise ValueError(f"{where}: cannot be read: {str(error)[:120]}") from error


def _numbers(part: str, value: np.ndarray) -> np.ndarray:
    """An array of a file as finite real numbers. Raises ValueError."""
    if value.dtype.kind not in "iufc":
        raise ValueError(f"'{part}' holds something else than numbers")
    if not np.all(np.isfinite(value)):
        raise ValueError(f"'{part}' holds numbers that are not finite")
    if np.any(value.imag != 0.0):
        raise ValueError(f"'{part}' has complex numbers. A law needs real ones")
    return np.asarray(value.real, float)


def _designed_us(file: Any) -> float:
    """The sampling interval of the design, us; 0 if it is not known. Raises ValueError."""
    try:
        dt = file["dt"] if "dt" in file.files else np.array(True)
    except ValueError:  # None, as NumPy stores it
        return 0.0
    if dt.dtype == bool:
        return 0.0
    if dt.size != 1 or dt.dtype.kind not in "iuf" or not np.isfinite(dt.item()):
        raise ValueError("'dt' must be one finite number, the sampling interval in s")
    if dt.item() == 0.0:
        raise ValueError(
            "dt = 0 marks a continuous filter. Convert it to discrete time at the scene's sampling "
            "interval, as with control.sample_system"
        )
    return max(0.0, 1e6 * float(dt.item()))


def _sections(arrays: dict[str, np.ndarray], where: str) -> np.ndarray:
    """Second-order sections of a state space with one input and one output, shape (n, 6).

    With r samples from the input to the output and h their first value, z^r times the transfer
    function is h + C A^r (z - A)^-1 B: its zeros are the eigenvalues of A - B C A^r/h, of which
    the r least are those of z^r. Raises ValueError.
    """
    from scipy.signal import zpk2sos

    a, b, c, d = arrays.values()
    n = len(np.atleast_2d(a))
    if a.size != n * n or b.size != n or c.size != n or d.size != 1:
        shapes = ", ".join(str(part.shape) for part in (a, b, c, d))
        raise ValueError(
            f"{where}: A, B, C and D have the shapes {shapes}. Save the one filter from the "
            "samples to the force: (n, n), (n, 1), (1, n), (1, 1)."
        )
    a, b, c = a.reshape(n, n), b.reshape(n), c.reshape(n)
    late, first, row = 0, d.item(), c
    while first == 0.0 and late < n:
        first = float(row @ b)
        if abs(first) < _ROUNDING * float(np.abs(row) @ np.abs(b)):
            first = 0.0
        late, row = late + 1, row @ a
    if first == 0.0:
        return np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    zeros = np.linalg.eigvals(a - np.outer(b, row) / first)
    zeros = zeros[np.argsort(np.abs(zeros))[late:]]
    z = np.exp(1j * np.geomspace(1e-4, np.pi, 100))
    wanted = np.array([c @ np.linalg.solve(at * np.eye(n) - a, b) + d.item() for at in z])
    powers = z[:, None] ** -np.arange(3.0)
    with suppress(ValueError):  # of zeros that rounding has taken out of their pairs
        # As if r were 0; its stub knows real zeros only.
        # pyrefly: ignore[bad-argument-type]
        rows = np.asarray(zpk2sos(zeros, np.linalg.eigvals(a), first))
        parts = [2] * (late // 2) + [1] * (late % 2)
        delays = [[0.0, float(r == 1), float(r == 2), 1.0, 0.0, 0.0] for r in parts]
        rows = np.array([*rows.tolist(), *delays])
        found = np.prod((powers @ rows[:, :3].T) / (powers @ rows[:, 3:].T), axis=1)
        if np.abs(found - wanted).max() <= _SAME * np.abs(wanted).max():
            return rows
    raise ValueError(
        f"{where}: the state space is too ill-conditioned to run as a filter. Save sections."
    )
