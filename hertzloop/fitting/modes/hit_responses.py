"""Records of force and response as hits from rest, which modes can be fitted to."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hertzloop.fitting.hits.find import EXCITATION, Hit, find_hits
from hertzloop.fitting.hits.judge import clipping, few_samples_before, motion_before
from hertzloop.fitting.hits.onset import NOISE_LEVELS, find_onset, noise_after
from hertzloop.fitting.hits.split import cut_hit
from hertzloop.fitting.modes.errors import ModalDataError
from hertzloop.fitting.records.chain_keys import FILTERS
from hertzloop.fitting.records.converter import clipped_samples
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.reading import read_record, read_records
from hertzloop.fitting.records.record import Record

ORDERS = {"xi_p": 0, "v_p": 1, "acceleration": 2}  # quantity of a response, time derivative
CHECKED_S = 0.04  # time after a hit in which errors are calculated
_FORCES = ("contact_force", "actuator_force")
_ALIKE_TIMES = 0.01  # largest difference of the times of force and response, over the interval
_ALIKE_RATES = 1e-6  # largest relative difference of the intervals of hits
_PULSE = 0.02  # share of the peak from which a force belongs to the pulse
_PULL = 0.3  # largest pull in a record of a contact, over its push: filters may overshoot
_NOISY = 1e-3  # share of noise in the square of a force, above which it counts as zero at rest
_MOST_CUT = 0.5  # largest share of the peak that counts as noise


@dataclass(frozen=True)
class HitResponse:
    """Force and response of a hit, from rest.

    Args:
        name: names of both records.
        force_n: force on the structure, N, (samples,).
        response: motion in the direction of the force, SI units, (samples,).
        interval_s: time from sample to sample, s.
        first: first sample of the hit.
        order: 0 of a displacement, 1 of a velocity, 2 of an acceleration.
        notes: sentences on hits of the records that are not used.
        window_s: time constant of the exponential window of the recorder, s; None without one.
    """

    name: str
    force_n: np.ndarray
    response: np.ndarray
    interval_s: float
    first: int
    order: int
    notes: tuple[str, ...] = ()
    window_s: float | None = None

    def apply_window(self, responses: np.ndarray) -> np.ndarray:
        """Return responses, (..., samples), times the window, which begins at the hit."""
        if self.window_s is None:
            return responses
        after_s = self.interval_s * np.maximum(np.arange(responses.shape[-1]) - self.first, 0)
        return responses * np.exp(-after_s / self.window_s)

    def with_force_before_window(self) -> "HitResponse":
        """Return the hit with the force that a window gave, if the window multiplied it too."""
        if self.window_s is None:
            return self
        in_pulse = np.flatnonzero(np.abs(self.force_n) > _PULSE * np.max(np.abs(self.force_n)))
        # The noise after the pulse would grow with the inverse of the window.
        after = np.clip(np.arange(len(self.force_n)) - self.first, 0, in_pulse[-1] - self.first)
        grown = np.exp(self.interval_s * after / self.window_s)
        return replace(self, force_n=self.force_n * grown)

    @property
    def checked(self) -> slice:
        """The samples over which errors are calculated."""
        return slice(self.first, self.first + math.ceil(CHECKED_S / self.interval_s))


def read_hits(paths: Sequence[Path], option: str = "--from") -> list[HitResponse]:
    """Return the hits of files that hold a force, a response, or both side by side.

    Args:
        paths: the files.
        option: the option that gives them, for messages.

    Raises:
        ModalDataError, RecordError: a file is no record, or the records do not belong together.
    """
    return hits_of_records([one for path in paths for one in _records_of(path)], option)


def _records_of(path: Path) -> Iterator[Record]:
    """The records of the tables of a file; of a file with one record also the column beside it that
    makes a pair of force and response."""
    first, *others = read_records(path)
    yield from (first, *others)
    if others:
        return
    for quantity in ORDERS if first.quantity in _FORCES else _FORCES:
        with suppress(RecordError):
            other = read_record(path, {"quantity": quantity})
            # One column alone gives the same record again.
            if not np.array_equal(other.value, first.value, equal_nan=True):
                yield other
                return


def hits_of_records(records: Sequence[Record], option: str = "--from") -> list[HitResponse]:
    """Return the hits of records.

    Args:
        records: forces and responses; the first force belongs to the first response, and so on. A
            record may hold several hits, at least 0.1 s apart. Those that cannot be used are left
            out then, and the first hit notes why.
        option: the option that gives the files, for messages.

    Raises:
        ModalDataError: records do not belong together, or no hit can be used.
    """
    hits: list[HitResponse] = []
    left_out: list[str] = []
    for force, response in _pairs(records, option):
        parts = list(_split_pair(force, response))
        for name, *part in parts:
            try:
                hits.append(_hit_response(name, *part))
            except ModalDataError as error:
                if len(parts) == 1:
                    raise
                left_out.append(f"Left out: {error}")
    if not hits:
        raise ModalDataError(" ".join(left_out))
    hits[0] = replace(hits[0], notes=tuple(left_out))
    for hit in hits:
        alike = abs(hit.interval_s / hits[0].interval_s - 1.0) <= _ALIKE_RATES
        if hit.order != hits[0].order or not alike:
            raise ModalDataError(
                f"{hit.name}: has another quantity or rate than {hits[0].name}. Give hits of one "
                "measurement."
            )
    return hits


def _pairs(records: Sequence[Record], option: str) -> list[tuple[Record, Record]]:
    """Return the forces with their responses. Raises ModalDataError if one is missing."""
    for one in records:
        if one.quantity not in (*_FORCES, *ORDERS):
            raise ModalDataError(
                f"record.quantity = '{one.quantity}': {one.name} is neither a force nor a motion "
                f"of the structure. Give records of contact_force and of {', '.join(ORDERS)}."
            )
    forces = [one for one in records if one.quantity in _FORCES]
    responses = [one for one in records if one.quantity in ORDERS]
    if not forces or len(forces) != len(responses):
        raise ModalDataError(
            f"{option}: {len(forces)} records of a force and {len(responses)} of a response. Give "
            "one of each for every hit, in the same order."
        )
    return list(zip(forces, responses, strict=True))


def _split_pair(force: Record, response: Record) -> Iterator[tuple[str, Record, Record]]:
    """Yield the hits of a force and a response: a name, and both records of a single hit."""
    name, hits = f"{force.name}, {response.name}", find_hits(force, EXCITATION)
    if len(hits) < 2:
        yield name, force, response
        return
    for number, hit in enumerate(hits, 1):
        yield f"{name}, hit {number}", _cut(force, hit, number), _cut(response, hit, number)


def _cut(record: Record, hit: Hit, number: int) -> Record:
    """Return a hit of a record, at the rate of the whole record."""
    one = cut_hit(record, hit, number)
    return replace(one, time_s=one.time_s[0] + record.interval_s * np.arange(len(one.value)))


def _hit_response(name: str, force: Record, response: Record) -> HitResponse:
    """Return a hit from rest. Raises ModalDataError if it cannot be used."""
    _check_measurement(name, force, response)
    for one in (force, response):
        _refuse(one, clipping(clipped_samples(one)))
    count, dt = min(len(force.value), len(response.value)), force.interval_s
    f, y = force.value[:count], response.value[:count]
    noise = noise_after(f)
    first = find_onset(f, noise)
    _refuse(force, few_samples_before(first, EXCITATION))
    last = min(count, first + math.ceil(EXCITATION.lasting_s / dt))
    f, y = f[:last] - np.mean(f[: first - 1]), y[:last] - np.mean(y[: first - 1])
    # A contact force is positive in contact and pushes the structure down; motion up is positive.
    sign = 1.0
    if force.quantity == "contact_force":
        sign = -1.0
        _check_sign(force.name, f)
    if len(f) * noise**2 > _NOISY * np.sum(f**2):  # The noise would drive the modes.
        high = np.abs(f) > min(NOISE_LEVELS * noise, _MOST_CUT * float(np.max(f)))
        f[np.flatnonzero(high)[-1] + 1 :] = 0.0
        f[: first - 2] = 0.0
    _refuse(response, motion_before(y, first, response.quantity))
    return HitResponse(name, f, sign * y, dt, first, ORDERS[response.quantity])


def _refuse(record: Record, defect: str) -> None:
    if defect:
        raise ModalDataError(f"{record.name}: {defect}")


def _check_measurement(name: str, force: Record, response: Record) -> None:
    """Raise ModalDataError if times, filters or gaps do not let force and response be compared."""
    count = min(len(force.value), len(response.value))
    apart_s = np.max(np.abs(force.time_s[:count] - response.time_s[:count]))
    if not (force.uniform and response.uniform) or apart_s > _ALIKE_TIMES * force.interval_s:
        raise ModalDataError(
            f"{name}: were not sampled at the same, evenly spaced times. Give force and response "
            "of one recorder."
        )
    if any(
        getattr(force.measurement, key) != getattr(response.measurement, key)
        for key in (*FILTERS, "low_pass", "low_pass_order")
    ):
        raise ModalDataError(
            f"{name}: their tables name different filters, which would count as the structure. "
            "Give records of equal filters."
        )
    for one in (force, response):
        if not np.all(np.isfinite(one.value)):
            raise ModalDataError(f"{one.name}: has gaps in its values. Give records without gaps.")


def _check_sign(name: str, force_n: np.ndarray) -> None:
    """Raise ModalDataError for a contact force that pulls."""
    pull, push = -float(np.min(force_n)), float(np.max(force_n))
    if pull <= _PULL * push:
        return
    raise ModalDataError(
        f"{name}: its peak is negative, and a contact pushes only. Turn its sign: give the record "
        "a negative sensitivity."
        if push < _PULL * pull
        else f"{name}: has both signs, {push:.3g} and {-pull:.3g} N, and a contact pushes only. "
        "Check whether force and response are swapped, and which filters the force has passed."
    )
