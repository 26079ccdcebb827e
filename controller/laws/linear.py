"""A digital filter: numerator and denominator, second-order sections, or a file of either."""

from io import BytesIO
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
        "", description="file with the filter (.npz, .mat); the scene keeps its numbers"
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


# A file names its arrays as scipy.signal, python-control and MATLAB do: `sos`, with its gain `g`;
# `b` and `a`, by powers of 1/z; `num` and `den`, by powers of z, the highest first. `dt` is the
# sampling interval, s: 0 of a continuous filter; True, None or a negative number if it is unknown.

_ENDINGS = (".npz", ".mat")
_FORMS = (("sos",), ("b", "a"), ("num", "den"))
_NAMES = ("sos", "b", "a", "num", "den", "dt", "g")
np.save(_stored := BytesIO(), np.array(None))
_NONE = _stored.getvalue()  # None as NumPy stores it, which is read without running a pickle


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
    given = [key for key in ("numerator", "denominator", "sections") if key in keys]
    found = _arrays(folder / name, where)
    form = _form(found, where)
    designed_us = _designed_us(found.get("dt"), where)
    for key in given:  # left by an earlier file, or a default that a recording wrote out
        del keys[key]
    del keys["filter_file"]
    values = [found[part] for part in form]
    for part, value in zip(form, values, strict=True):
        if not np.all(np.isfinite(value)):
            raise ValueError(f"{where}: '{part}' holds numbers that are not finite.")
    if form == ("sos",):
        rows = np.atleast_2d(values[0])
        if rows.ndim != 2 or rows.shape[1] != 6:
            raise ValueError(f"{where}: 'sos' has shape {rows.shape}. Give n rows of 6 numbers.")
        gains = found.get("g", np.ones(1))
        if gains.size not in (1, len(rows) + 1) or not np.all(np.isfinite(gains)):
            raise ValueError(
                f"{where}: 'g' beside 'sos' has {gains.size} numbers. Give the gain, or the gains "
                f"of the {len(rows)} sections and of the output."
            )
        rows[0, :3] *= np.prod(gains)
        keys["sections"] = rows.tolist()
    else:
        top, bottom = (np.atleast_1d(np.squeeze(value)) for value in values)
        for part, value in zip(form, (top, bottom), strict=True):
            if value.ndim > 1:
                raise ValueError(
                    f"{where}: '{part}' has shape {value.shape}, as of several outputs or of "
                    "a state space. Save the one filter from the samples to the force."
                )
        if form == ("num", "den"):
            top, bottom = np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f")
            late = len(bottom) - len(top)
            if late < 0 or not len(top):
                raise ValueError(
                    f"{where}: 'num' has {len(top)} coefficients and 'den' {len(bottom)}. A filter "
                    "that can run has at most as many in 'num'."
                )
            top = np.concatenate([np.zeros(late), top])
        keys["numerator"], keys["denominator"] = top.tolist(), bottom.tolist()
    keys["designed_us"] = designed_us


def _form(found: dict[str, np.ndarray], where: str) -> tuple[str, ...]:
    """Names of the arrays that are the filter. Raises ValueError without exactly one filter."""
    forms = [form for form in _FORMS if all(part in found for part in form)]
    # Beside another filter, two numbers `b` and `a` are lengths rather than a gain.
    filters = [form for form in forms if any(found[part].size > 1 for part in form)] or forms
    if not filters:
        raise ValueError(
            f"{where}: holds no filter. Save the arrays sos, or b and a, or num and den."
        )
    if len(filters) > 1:
        names = " and ".join(", ".join(form) for form in filters)
        raise ValueError(f"{where}: holds more than one filter: {names}. Save one alone.")
    if filters == [("b", "a")] and found["b"].size == found["a"].size == 1 and "c, d" in found:
        raise ValueError(
            f"{where}: a, b, c and d may be a state space. Save it as the arrays num and den."
        )
    return filters[0]


def _designed_us(dt: np.ndarray | None, where: str) -> float:
    """The sampling interval of the design, us; 0 if it is not known. Raises ValueError."""
    if dt is None or dt.dtype == bool:
        return 0.0
    step_s = float(dt.ravel()[0]) if dt.size else 0.0
    if step_s == 0.0:
        raise ValueError(
            f"{where}: dt = 0 marks a continuous filter. Convert it to discrete time at the "
            "scene's sampling interval, as with control.sample_system."
        )
    if dt.size > 1 or not np.isfinite(step_s):
        raise ValueError(f"{where}: 'dt' must be one finite number, the sampling interval in s.")
    return max(0.0, 1e6 * step_s)


def _arrays(path: Path, where: str) -> dict[str, np.ndarray]:
    """Arrays of numbers in a file, by name. Raises ValueError."""
    if path.suffix not in _ENDINGS:
        raise ValueError(f"{where}: unknown format. Use a file that ends in .npz or .mat.")
    found: dict[str, Any] = {}
    try:
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as file:
                there = set(file.files)
                for name in set(_NAMES) & there:
                    if file.zip.read(f"{name}.npy") != _NONE:
                        found[name] = file[name]
        else:
            import scipy.io  # 0.2 s of every start, for files of this kind alone

            found = scipy.io.loadmat(path, squeeze_me=True)
            there = set(found)
    except OSError as error:
        why = why_unreadable(path, error, "Give the path of a filter.")
        raise ValueError(f"{where}: cannot be read: {why}") from error
    except Exception as error:  # SciPy raises whatever its parser meets
        raise ValueError(f"{where}: cannot be read: {str(error)[:120]}") from error
    numbers = {"c, d": np.empty(0)} if {"c", "d"} <= there else {}
    for name in _NAMES:
        if name not in found:
            continue
        value = np.asarray(found[name])
        if np.iscomplexobj(value) and np.any(value.imag != 0.0):
            raise ValueError(f"{where}: '{name}' has complex numbers. A law needs real ones.")
        try:
            numbers[name] = value if value.dtype == bool else value.real.astype(float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{where}: '{name}' holds something else than numbers.") from error
    return numbers
