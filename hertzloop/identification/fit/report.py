"""A fit as JSON, as a scene with a `[fit]` table, and as text for the terminal."""

import math
from typing import Any

import numpy as np

from hertzloop.identification.fit.results import Estimate, FitResult
from hertzloop.identification.fit.verdicts import WIDEST, KeyVerdict, ModelVerdict
from hertzloop.scene.tables import FitTable
from hertzloop.scene.toml import to_toml
from hertzloop.views.format import Table

_OPEN = "open"
_MODEL_WORDS = {
    ModelVerdict.FITS: "The model fits.",
    ModelVerdict.DOES_NOT_FIT: "The model does not fit.",
    ModelVerdict.CANNOT_TELL: "The records cannot tell whether the model fits.",
}


def as_json(result: FitResult) -> dict[str, Any]:
    """Return a fit as data for JSON: see docs/reference/fit-json.md for the fields."""
    by_record = {
        n.record: {
            "time_shift_s": n.time_shift_s,
            "gain": n.gain,
            "offset": n.offset,
            "clock_ppm": n.clock_ppm,
            "noise_rms": n.noise_rms,
            "residual_over_noise": n.residual_over_noise,
            "samples": n.samples,
            "rejected_samples": n.rejected,
            "in_pulse_percent": n.off_percent[0],
            "after_pulse_percent": n.off_percent[1],
            "largest_percent": n.off_percent[2],
            "model_error_in_pulse_percent": n.error_percent[0],
            "model_error_after_pulse_percent": n.error_percent[1],
        }
        for n in result.nuisances
    }
    first = next(iter(by_record.values()))
    keys = ("time_shift_s", "gain", "offset", "clock_ppm")
    return {
        "parameters": {e.key: _estimate_json(e) for e in result.estimates},
        "nuisances": {key: first[key] for key in keys} | {"by_record": by_record},
        "noise_rms": result.noise_rms,
        "residual_over_noise": result.residual_over_noise,
        "model": str(result.model),
        "statistics": result.statistics,
        "reasons": result.reasons,
        "combinations": [
            {
                "keys": c.exponents,
                "combination": str(c),
                "half_width_percent": c.half_width_percent,
            }
            for c in result.combinations
        ],
        "measure_next": result.measure_next,
        "hold_out": result.hold_out,
        "covariance_log": np.asarray(result.covariance).tolist(),
        "speeds_m_s": list(result.speeds_m_s),
        "records": [{"name": r.name, "sha256": r.sha256} for r in result.records],
        "notes": result.notes,
        "checked_only": result.checked_only,
        "scene": None,
        "evaluations": result.evaluations,
        "wall_s": result.wall_s,
    }


def _estimate_json(e: Estimate) -> dict[str, Any]:
    return {
        "value": e.value,
        "low": e.low,
        "high": e.high,
        "verdict": str(e.verdict),
        "half_width_percent": e.half_width_percent,
        "start": e.start,
        "half_width_alone_percent": e.alone_percent,
        "prior_pull_sigma": e.prior_pull,
    }


def fit_table(result: FitResult) -> FitTable:
    """Return the `[fit]` table of a fitted scene, without the speeds of single hits."""
    shared = [i for i, e in enumerate(result.estimates) if "[" not in e.key]
    estimates = [result.estimates[i] for i in shared]
    covariance = result.covariance[np.ix_(shared, shared)]
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    for i, e in enumerate(estimates):
        if e.verdict is not KeyVerdict.IDENTIFIED:
            covariance[i, :] = covariance[:, i] = 0.0
    return FitTable(
        keys=tuple(e.key for e in estimates),
        values=tuple(e.value for e in estimates),
        low=tuple(_OPEN if e.low is None else e.low for e in estimates),  # type: ignore[misc]
        high=tuple(_OPEN if e.high is None else e.high for e in estimates),  # type: ignore[misc]
        verdicts=tuple(str(e.verdict) for e in estimates),
        covariance_log=tuple(float(v) for v in covariance.ravel()),
        model=str(result.model),
        residual_over_noise=float(result.residual_over_noise),
        records=tuple(r.name for r in result.records),
        sha256=tuple(r.sha256 for r in result.records),
        speeds_m_s=result.speeds_m_s,
    )


def fitted_scene(result: FitResult, name: str) -> str:
    """Return the fitted scene as TOML, with its `[fit]` table. Raises ValueError of a check."""
    if result.setup is None:
        raise ValueError("a check has no fitted scene")
    scene = result.setup.scene.replaced(name=name, fit=fit_table(result))
    return to_toml(scene)


def _percent(value: float) -> str:
    return f"{value:.2g} %" if value < 100.0 else f"{value:z.0f} %"


def number(value: float | None, digits: int = 5) -> str:
    """Write a number, or "open" for the end of an interval that is open."""
    return _OPEN if value is None else f"{value:.{digits}g}"


def parameter_table(result: FitResult) -> Table:
    """Return the table of keys, estimates, intervals and verdicts."""
    title = "What the records can tell" if result.checked_only else "Fitted keys"
    table = Table(title=title)
    for heading in ("key", "value", "95 % interval", "+/-", "verdict"):
        table.add_column(heading, justify="left" if heading in ("key", "verdict") else "right")
    for e in result.estimates:
        half = e.half_width_percent
        width = "-" if half is None else f"{half:.2g} %" if half < 1e3 else "no bound"
        interval = f"{number(e.low)} to {number(e.high)}"
        table.add_row(e.key, number(e.value, 6), interval, width, str(e.verdict))
    return table


def sentences(result: FitResult) -> list[str]:
    """Return what a fit comes to, in sentences."""
    found = list(result.notes)
    for e in result.estimates:
        if e.verdict is KeyVerdict.ONE_SIDED:
            limit = f"at least {number(e.low)}" if e.high is None else f"at most {number(e.high)}"
            low, high = result.speeds_m_s
            found.append(
                f"{e.key} is {limit} (95 %): the records, at impact speeds of {low:.3g} to "
                f"{high:.3g} m/s, set no limit on the other side."
            )
        if e.resolution is not None:
            found.append(
                f"{e.key} is fitted in steps of {e.resolution:g} us, and its interval reaches half "
                "a step beyond the values that explain the records."
            )
    found += _unidentified_sentences(result)
    found += result.measure_next
    if result.checked_only:
        return found
    found.append(
        f"Residual over noise: {result.residual_over_noise:.3g}. {_MODEL_WORDS[result.model]}"
    )
    found += result.reasons
    found += [_accuracy_sentence(n.record, *n.off_percent) for n in result.nuisances]
    if any(any(n.error_percent) for n in result.nuisances):
        errors = "; ".join(
            f"{n.record}: {_percent(n.error_percent[0])} in the pulse and "
            f"{_percent(n.error_percent[1])} after it"
            for n in result.nuisances
        )
        found.append(
            f"The model is not exact. Its error, of the local signal, is estimated with the keys, "
            f"and the intervals include it. {errors}."
        )
    held = result.hold_out
    if held is not None:
        found.append(f"Held-out records: residual over noise {held['residual_over_noise']:.3g}.")
        ends = ("in_pulse_percent", "after_pulse_percent", "largest_percent")
        parts = held["records"], *(held[end] for end in ends)
        found += [
            _accuracy_sentence(f"{name} (held out)", *off)
            for name, *off in zip(*parts, strict=True)
        ]
    for n in result.nuisances:
        found.append(
            f"{n.record}: touch at {n.time_shift_s:.9g} s, gain {n.gain:.4g}, offset "
            f"{n.offset:.3g}, clock {n.clock_ppm:+.3g} ppm, noise {n.noise_rms:.3g}."
        )
    if not math.isnan(result.wall_s):
        found.append(f"{result.evaluations} simulations in {result.wall_s:z.2f} s.")
    return found


def _accuracy_sentence(
    record: str, pulse: float | None, after: float | None, largest: float | None
) -> str:
    """The second part of the verdict: how far the simulation is from a record."""
    parts = [
        f"{_percent(off)} of the peak {where}"
        for off, where in ((pulse, "in the pulse"), (after, "after it"))
        if off is not None
    ]
    most = "" if largest is None else f"; largest error {_percent(largest)}"
    return f"{record}: good to {' and '.join(parts)} (root mean square{most})."


def _unidentified_sentences(result: FitResult) -> list[str]:
    """Name what the records cannot tell: combinations first, then each key with the reason."""
    keys = [e for e in result.estimates if e.verdict is KeyVerdict.NOT_IDENTIFIABLE]
    if not keys:
        return []
    worst = [c for c in result.combinations if c.half_width_percent > 100.0 * WIDEST]
    named = {key for c in worst for key in c.exponents}
    parts = [str(c) for c in worst] + [e.key for e in keys if e.key not in named]
    return [
        f"Not identifiable from these records: {'; '.join(parts)}.",
        *(_why_unidentified(e, len(result.estimates) > 1) for e in keys),
    ]


def _why_unidentified(e: Estimate, others: bool) -> str:
    if e.resolution is not None:
        return f"{e.key}: the records allow {number(e.low)} to {number(e.high)}."
    half, alone = e.half_width_percent, e.alone_percent
    if half is None or half >= 1e3:
        known = f"{e.key}: the records set no useful bound"
    else:
        known = f"{e.key}: the half-width is {_percent(half)}, more than {100.0 * WIDEST:g} %"
    if not others:
        return f"{known}."
    if alone is None or alone > 100.0 * WIDEST:
        return f"{known}, even if the other keys are known."
    return f"{known}. It falls to {_percent(alone)} if the other keys are known."
