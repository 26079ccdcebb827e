"""A run's result in words: whether control helped, in what, why not; what spoils the figures.

Decibels have one digit: where in a sample the touch falls decides about the second.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from hertzloop.results.digits import UNKNOWN, change_db, known_digits
from hertzloop.results.impact_rows import F_A, F_C, Block
from hertzloop.results.predictability import errors_of
from hertzloop.setup import Setup

_HARDLY_DB = 0.1
_MUCH = 0.1  # share of the push, or of the contact, that is worth a word
_FIGURES = (
    ("radiated_j", "radiated energy", 10.0),
    ("plate_speed_max_m_s", "largest plate speed", 20.0),
)


class PushMeter:
    """When an actuator pushes, against the contacts, over rows of truth that come in blocks."""

    def __init__(self, setup: Setup) -> None:
        self._step_s = setup.step_s
        self._apart = self._all = 0.0  # impulse while nothing touches, and all, in N steps
        self._touch: int | None = None
        self._push: int | None = None

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        touching, pushed = rows[F_C] != 0.0, np.abs(rows[F_A])
        if self._touch is None and touching.any():
            self._touch = first + int(np.argmax(touching))
        if self._push is None and pushed.any():
            self._push = first + int(np.argmax(pushed > 0.0))
        self._all += float(np.sum(pushed))
        self._apart += float(np.sum(pushed[~touching]))

    def through(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, followed as they pass."""
        for first, rows in blocks:
            self.feed(first, rows)
            yield first, rows

    def result(self) -> dict[str, float] | None:
        """`after_touch_s`: from the first contact to the first force (negative: before), nan
        without a contact; `apart`: share of the push while nothing touches. None without one."""
        if self._push is None:
            return None
        steps = math.nan if self._touch is None else self._push - self._touch
        return {"after_touch_s": steps * self._step_s, "apart": self._apart / self._all}


def verdict(report: dict[str, Any], saturation: dict[str, Any] | None) -> list[str]:
    """Sentences on a run's figures, as in `figures.run_report`; without those of the same run
    without control (`uncontrolled`) on that alone which spoils them."""
    said = []
    free = report.get("uncontrolled")
    stability = report["stability"] or {"unstable": False, "pumps": False}
    if stability["pumps"] and not stability["unstable"]:
        said.append(pumping(stability))
    if stability["unstable"]:
        said.append(unstable(stability))
    elif not report["impacts"]:
        said.append("No impact within the run.")
    elif free is not None and report["scene_law"] != "off" and free["impacts"]:
        said += _compared(report, free)
    if report["impacts"] and not report["last_contact_ended"]:
        said.append(
            "The last contact is not over at the end of the run: its length, its rebound and the "
            "energies have what there is of it; take a longer run.duration_s."
        )
    if saturation is not None:
        times = saturation["times"]
        said.append(
            f"The samples left the sensor's range {'once' if times == 1 else f'{times} times'}, "
            f"first at {saturation['since_s'] * 1e3:.4g} ms: there the law saw the end of the "
            "range, not what happened (sensors.full_scale)."
        )
    return said


def unstable(stability: dict[str, Any]) -> str:
    """That the loop is unstable, from when on, and how far it went."""
    since = ""
    if stability["since_s"] is not None:
        since = f" From {stability['since_s'] * 1e3:.4g} ms on it has put in more than all of it."
    return (
        "UNSTABLE: the actuator answers what it causes itself and puts in "
        f"{stability['most_injected']:.3g} times the energy of the impact.{since} Its largest "
        f"force, {stability['largest_force_n']:.3g} N, is {stability['of_contact']:.3g} times what "
        "the impact can cause. A comparison with the run without control would say nothing."
    )


def pumping(stability: dict[str, Any]) -> str:
    """That the loop puts in more than there was, though it does not go on doing so."""
    since = ""
    if stability["since_s"] is not None:
        since = f", from {stability['since_s'] * 1e3:.4g} ms on"
    return (
        f"The loop pumps: the actuator puts in {stability['fed_in']:.2g} times the energy that the "
        f"sphere brought{since}. What moves then is its own doing: no impact could cause it."
    )


def _compared(report: dict[str, Any], free: dict[str, Any]) -> list[str]:
    """Whether control helped, in what, and why not."""
    if report["push"] is None:
        return ["Control did nothing: the law never pushed."]
    once = len(report["impacts"]) == len(free["impacts"]) == 1
    better, worse = _others(report, free, "" if once else " (first impact)")
    energy, error, over = _plate_energy(report, free)
    change = known_digits(energy, "+.1f", error)
    if error > _HARDLY_DB and change == UNKNOWN:
        return [
            "Whether control helps is not predictable: the model's error, which the first impact "
            "magnifies, is larger than the change of the plate energy."
        ]
    if energy < -_HARDLY_DB:
        words = f"Control helps: plate energy {change} dB{over}"
    elif energy > _HARDLY_DB:
        words = f"Control does harm: plate energy {change} dB{over}"
    else:
        words = f"Control hardly changes the plate energy{over}"
    words += "".join(f", {word}" for word in better)
    if worse:
        words += f"; {'but' if better or energy < 0.0 else 'and'} {', '.join(worse)}"
    said = [f"{words}."]
    if not energy < -_HARDLY_DB:
        said += _why(report, free["impacts"][0]["duration_s"])
    return said


def _plate_energy(report: dict[str, Any], free: dict[str, Any]) -> tuple[float, float, str]:
    """Change of the plate energy (dB), its error, and over what: all contacts, or the first one
    where later ones are not predictable to the digit that is printed."""
    known = report.get("predictability", {})
    sums, errors, whole = [], [], []
    for found, name in ((report, "controlled"), (free, "uncontrolled")):
        impacts = found["impacts"]
        sums.append([impact["plate_energy_j"] for impact in impacts])
        run = found.get("whole_run")  # None of the published scheme
        whole.append(run["plate_energy_j"] if run else sum(sums[-1]))
        errors.append(
            [errors_of(known.get(name), i).get("plate_energy_j", 0.0) for i in range(len(impacts))]
        )
    energy, error = change_db(whole[0], whole[1], 10.0, sum(errors[0]), sum(errors[1]))
    if len(sums[0]) == len(sums[1]) == 1:
        return energy, error, ""
    if known.get("why_not"):
        over = " (first impact; whether later ones are predictable is not known)"
    elif error <= _HARDLY_DB:
        return energy, error, " over all contacts"
    else:
        over = " (first impact; later ones are not predictable)"
    return *change_db(sums[0][0], sums[1][0], 10.0, errors[0][0], errors[1][0]), over


def _others(report: dict[str, Any], free: dict[str, Any], of: str) -> tuple[list[str], list[str]]:
    """Other figures that are better, and worse, of the first impact."""
    better: list[str] = []
    worse: list[str] = []
    if not report["noise"] or not free["noise"]:
        return better, worse
    with_, without = report["noise"][0], free["noise"][0]
    known = report.get("predictability", {})
    wrong, other = (
        errors_of(known.get(name), 0, "noise_errors") for name in ("controlled", "uncontrolled")
    )
    for key, name, factor in _FIGURES:
        change, error = change_db(
            with_[key], without[key], factor, wrong.get(key, 0.0), other.get(key, 0.0)
        )
        said = known_digits(change, "+.1f", error)
        if abs(change) > _HARDLY_DB and said != UNKNOWN:
            (better if change < 0.0 else worse).append(f"{name} {said} dB{of}")
    key = "rebound_height_m"
    height, before = with_[key], without[key]
    if before > 0.0 and abs(height / before - 1.0) > 0.02:
        error = (wrong.get(key, 0.0) + other.get(key, 0.0) * height / before) / before
        share = known_digits(100.0 * height / before, ".0f", 100.0 * error)
        if share == UNKNOWN:
            return better, worse
        share = f"the sphere rebounds {share} % as high"
        if height > 1e3 * before:  # which lies within the model's error
            share = "the sphere rebounds, where it hardly did"
        (better if height < before else worse).append(share)
    return better, worse


def _why(report: dict[str, Any], contact_s: float) -> list[str]:
    """What the rows say of the reasons."""
    push, reasons = report["push"], []
    late = push["after_touch_s"] / contact_s
    if late > _MUCH:
        reasons.append(
            f"its first force comes {1e6 * push['after_touch_s']:.3g} us after the touch, "
            f"{100.0 * late:.0f} % of the contact without control"
        )
    if push["apart"] > _MUCH:
        reasons.append(f"{100.0 * push['apart']:.0f} % of its push falls where nothing touches")
    if report["injected_j"] > 0.0:
        reasons.append(f"it puts {1e6 * report['injected_j']:.3g} uJ into the plate")
    if report["yield"] and "dent" not in report["scene_law"]:
        reasons.append(
            f"the plate keeps a dent of {1e6 * report['yield']['dent_m']:.2g} um, which a law that "
            "answers the gap takes for penetration"
        )
    return [f"Why not: {'; '.join(reasons)}."] if reasons else []


def saturation_of(events: Iterable[Any]) -> dict[str, Any] | None:
    """How often, and since when (s), samples were out of the converter's range where it matters, by
    a recording's events: a gap during a contact, anything else at any time. None if never."""
    since_ns: list[int] = []
    touching = out = counted = False
    for event in events:
        if event.name != "plant":
            continue
        if event.message.startswith("contact "):
            touching = event.message.endswith("began")
        elif event.message.endswith("converter's range"):
            out, counted = "left the" in event.message, False
        matters = touching or not event.message.startswith("xi ")
        if out and matters and not counted:
            since_ns.append(event.time_ns)
            counted = True
    return {"times": len(since_ns), "since_s": since_ns[0] * 1e-9} if since_ns else None
