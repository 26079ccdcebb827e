"""Hits of a hammer, measured as records of force and response, as observed responses."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy

from hertzloop.identification.modes.identify import FLEXIBILITY_M_N, ResponseRows
from hertzloop.identification.modes.universal import ModalDataError
from hertzloop.identification.records.chain_keys import FILTERS
from hertzloop.identification.records.converter import clipped_samples
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.reading import read_record, read_records
from hertzloop.identification.records.record import Record

ORDERS = {"xi_p": 0, "v_p": 1, "acceleration": 2}
_FORCES = ("contact_force", "actuator_force")
JUDGED_S = 0.04  # after the hit, over which errors are told
_LONGEST_S = 0.1  # after the hit, that is fitted
_FEWEST = 8  # samples before the hit
_RISE = 0.02  # of the peak, at which a hit begins
_MOST_RISE, _OVER_NOISE = 0.5, 5.0  # the same at most; standard deviations of noise
_ANOTHER, _BEFORE_S = 0.3, 0.01  # of the highest peak: another hit; what belongs to it before it
_NOISY = 1e-3  # of the square of a force, of noise
_BAND = 0.45  # of the rate, up to which a converter passes
_LEAST_WIDTH = 0.02  # of what a record resolves, for the bandwidth of a mode
_LOWEST_PERIODS = 0.5  # of the lowest mode within a record
_BLOCK = 64
_PULLS = 0.3  # of the peak, that a force may have of the other sign
_TAPER, _PROMINENT = 5.0, 0.15  # of peaks: decay within a record; 3 dB, as a logarithm
_EXCITED = 1e-3  # of the largest square of the force: what counts as excited
_MOVES, _SHOWN = 0.05, 64  # rms before a hit, of the peak; samples that show it


@dataclass(frozen=True)
class Hit:
    """A hit: force (N) and response, from rest; both (samples,), `interval_s` apart, `first` is the
    sample at which it begins. `order`: 0 displacement, 1 velocity, 2 acceleration, in SI units, in
    the direction of the force. `notes`: sentences on hits beside it that are left out. `window_s`:
    time constant of the exponential window that the recorder put on the response."""

    name: str
    force_n: np.ndarray
    response: np.ndarray
    interval_s: float
    first: int
    order: int
    notes: tuple[str, ...] = ()
    window_s: float | None = None

    def as_recorded(self, rows: np.ndarray) -> np.ndarray:
        """Responses (..., samples) as the recorder gives them, by its window from the hit on."""
        if self.window_s is None:
            return rows
        after_s = self.interval_s * np.maximum(np.arange(rows.shape[-1]) - self.first, 0)
        return rows * np.exp(-after_s / self.window_s)

    def of_windowed_force(self) -> "Hit":
        """The same, of a recorder whose window multiplies the force too."""
        if self.window_s is None:
            return self
        in_pulse = np.flatnonzero(np.abs(self.force_n) > _RISE * np.max(np.abs(self.force_n)))
        # What follows the pulse is noise.
        after = np.clip(np.arange(len(self.force_n)) - self.first, 0, in_pulse[-1] - self.first)
        grown = np.exp(self.interval_s * after / self.window_s)
        return replace(self, force_n=self.force_n * grown)

    @property
    def judged(self) -> slice:
        """The samples over which errors are told."""
        return slice(self.first, self.first + math.ceil(JUDGED_S / self.interval_s))


def read_hits(paths: Sequence[Path], option: str = "--from") -> list[Hit]:
    """Return the hits of files that hold a force, a response, or both side by side. `option`: the
    one that gives the files.

    Raises:
        ModalDataError, RecordError: a file is no record, or the records do not belong together.
    """
    return hits_of_records([one for path in paths for one in _records_of(path)], option)


def _records_of(path: Path) -> Iterator[Record]:
    """The records of the tables of a file; of a single one also another record beside it."""
    first, *others = read_records(path)
    yield from (first, *others)
    if others:
        return
    for quantity in ORDERS if first.quantity in _FORCES else _FORCES:
        with suppress(RecordError):
            other = read_record(path, {"quantity": quantity})
            if _column(other) != _column(first):
                yield other
                return


def _column(record: Record) -> str:
    """Where its values are in the file."""
    return record.source.partition(f"; {record.quantity}: ")[2].partition(" in ")[0]


def hits_of_records(records: Sequence[Record], option: str = "--from") -> list[Hit]:
    """Return the hits of records: the first record of a force belongs to the first one of a
    response, and so on. A record may hold several hits, at least 0.1 s apart; those that cannot be
    used are left out then.

    Raises:
        ModalDataError: records do not belong together, or a hit is clipped or does not begin at
            rest.
    """
    forces = [one for one in records if one.quantity in _FORCES]
    responses = [one for one in records if one.quantity in ORDERS]
    for one in records:
        if one.quantity not in (*_FORCES, *ORDERS):
            raise ModalDataError(
                f"record.quantity = '{one.quantity}': {one.name} is neither a force nor a motion "
                f"of the structure. Give records of contact_force and of {', '.join(ORDERS)}."
            )
    if not forces or len(forces) != len(responses):
        raise ModalDataError(
            f"{option}: {len(forces)} records of a force and {len(responses)} of a response. Give "
            "one of each for every hit, in the same order."
        )
    hits: list[Hit] = []
    left_out: list[str] = []
    for pair in zip(forces, responses, strict=True):
        parts = list(_apart(*pair))
        for part in parts:
            try:
                hits.append(_hit(*part))
            except ModalDataError as error:
                if len(parts) == 1:
                    raise
                left_out.append(f"Left out: {error}")
    if not hits:
        raise ModalDataError(" ".join(left_out))
    hits[0] = replace(hits[0], notes=tuple(left_out))
    for hit in hits:
        if hit.order != hits[0].order or abs(hit.interval_s / hits[0].interval_s - 1.0) > 1e-6:
            raise ModalDataError(
                f"{hit.name}: has another quantity or rate than {hits[0].name}. Give hits of one "
                "measurement."
            )
    return hits


def _apart(force: Record, response: Record) -> Iterator[tuple[Record, Record]]:
    away = np.abs(force.value - np.median(force.value))
    above = np.flatnonzero(away > _ANOTHER * np.max(away))
    starts = above[1:][np.diff(above) * force.interval_s > _LONGEST_S]
    begins = [0, *(starts - math.ceil(_BEFORE_S / force.interval_s))]
    if not len(starts):
        yield force, response
        return
    for i, (begin, end) in enumerate(pairwise([*begins, None]), 1):
        # All parts of a record have its rate.
        first, second = (
            replace(
                one,
                name=f"{one.name} (hit {i})",
                value=one.value[begin:end],
                time_s=one.time_s[begin] + one.interval_s * np.arange(len(one.value[begin:end])),
            )
            for one in (force, response)
        )
        yield first, second


def _hit(force: Record, response: Record) -> Hit:
    name = f"{force.name}, {response.name}"
    count = min(len(force.value), len(response.value))
    apart = np.abs(force.time_s[:count] - response.time_s[:count])
    dt = force.interval_s
    if not (force.uniform and response.uniform) or np.max(apart) > 0.01 * dt:
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
        cut = int(np.count_nonzero(clipped_samples(one)))
        if cut:
            raise ModalDataError(
                f"{one.name}: {cut} samples are clipped at the end of the range. Measure with a "
                "larger range, or hit less hard."
            )
    f, y = force.value[:count], response.value[:count]
    away, tail = np.abs(f - np.median(f[:_FEWEST])), f[-(-count // 4) :]
    noise = 1.4826 * float(np.median(np.abs(tail - np.median(tail))))  # of a normal one
    begins = np.clip(_OVER_NOISE * noise / np.max(away), _RISE, _MOST_RISE)
    # A converter's filter may ring before the hit.
    top = int(np.argmax(away > max(begins, _ANOTHER) * np.max(away)))
    still = np.flatnonzero(away[:top] <= begins * np.max(away))
    first = int(still[-1]) + 1 if len(still) else 0
    if first < _FEWEST:
        raise ModalDataError(
            f"{force.name}: has {first} samples before the hit. Give at least {_FEWEST}, at rest."
        )
    last = min(count, first + math.ceil(_LONGEST_S / dt))
    f, y = f[:last] - np.mean(f[: first - 1]), y[:last] - np.mean(y[: first - 1])
    # A contact force is positive in contact and pushes the structure down; motion up is positive.
    sign = -1.0 if force.quantity == "contact_force" else 1.0
    low, high = -float(np.min(f)), float(np.max(f))
    if force.quantity == "contact_force" and low > _PULLS * high:
        raise ModalDataError(
            f"{force.name}: its peak is negative, and a contact pushes only. Turn its sign: give "
            "the record a negative sensitivity."
            if high < _PULLS * low
            else f"{force.name}: has both signs, {high:.3g} and {-low:.3g} N, and a contact pushes "
            "only. Check whether force and response are swapped, and which filters the force has "
            "passed."
        )
    if len(f) * noise**2 > _NOISY * np.sum(f**2):  # it would drive the modes
        f[np.flatnonzero(np.abs(f) > min(_OVER_NOISE * noise, _MOST_RISE * high))[-1] + 1 :] = 0.0
        f[: first - 2] = 0.0
    moves = np.std(y[max(0, first - _SHOWN) : first - 2]) / np.max(np.abs(y[first:]))
    if moves > _MOVES:
        raise ModalDataError(
            f"{response.name}: is not at rest before the hit: its rms there is {100 * moves:.0f} % "
            f"of its largest value, the most is {100 * _MOVES:g} %. Wait longer between hits."
        )
    return Hit(name, f, sign * y, dt, first, ORDERS[response.quantity])


def rows_of_hits(hits: Sequence[Hit], at_contact: bool) -> ResponseRows:
    """Return hits as what modes are fitted to; a response `at_contact`, at the point that is hit,
    has a residual flexibility."""
    dt = hits[0].interval_s
    longest = max(len(one.force_n) for one in hits) * dt

    def basis(omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [one.as_recorded(_responses(one, omega, loss)) for one in hits], axis=1
        )

    values = np.concatenate([one.response for one in hits])[None]
    rest = np.concatenate([one.as_recorded(_stiff(one)) for one in hits])[None][: int(at_contact)]
    return ResponseRows(
        basis,
        rest,
        values,
        np.full(values.shape, 1.0 / np.sqrt(np.mean(values**2))),
        (_LOWEST_PERIODS / longest, _BAND / dt),
        1.0 / longest,
        0 if at_contact else None,
        _LEAST_WIDTH / longest,
    )


def _spectrum(hit: Hit) -> tuple[np.ndarray, np.ndarray, int]:
    """Spectrum of the force with as many zeros or more behind it, its angular frequencies, and
    its length."""
    length = 2 * scipy.fft.next_fast_len(len(hit.force_n), real=True)
    return (
        np.fft.rfft(hit.force_n, length),
        2 * np.pi * np.fft.rfftfreq(length, hit.interval_s),
        length,
    )


def _responses(hit: Hit, omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Responses of modes of unit residue from rest, (modes, samples).

    Of the force with nothing above half the rate, exactly: what repeats with the record, less the
    free vibration that makes it begin at rest.
    """
    force, w, length = _spectrum(hit)
    count = len(hit.force_n)
    o, damping = omega[:, None], (loss * omega)[:, None]
    periodic = force / (o**2 - w**2 + 1j * damping * w)
    moved = 1j * w * periodic
    moved[:, -1] = 0.0  # half the rate has no velocity
    q, v = (_first(one) / length for one in (periodic, moved))
    s = omega * (-loss / 2.0 + 1j * np.sqrt(1.0 - loss**2 / 4.0))
    start = q - 1j * (v - s.real * q) / s.imag
    if hit.order == 2:
        moved = force - damping * moved - o**2 * periodic
    shown = np.fft.irfft(moved if hit.order else periodic, length)[:, :count]
    # exp(s t) in blocks, which is quicker than one by one.
    blocks = np.exp(s[:, None] * (hit.interval_s * _BLOCK * np.arange(-(-count // _BLOCK))))
    within = np.exp(s[:, None] * (hit.interval_s * np.arange(_BLOCK)))
    free = (start * s**hit.order)[:, None, None] * blocks[:, :, None] * within[:, None, :]
    return shown - free.real.reshape(len(omega), blocks.shape[1] * _BLOCK)[:, :count]


def _first(spectrum: np.ndarray) -> np.ndarray:
    """First values of real series by their spectra, (modes, lines), times their length."""
    ends = spectrum[:, 0] + spectrum[:, -1]
    return np.asarray((2.0 * np.sum(spectrum, axis=1) - ends).real)


def _stiff(hit: Hit) -> np.ndarray:
    """Response of a spring, (samples,)."""
    force, w, length = _spectrum(hit)
    found = np.fft.irfft((1j * w) ** hit.order * force, length)[: len(hit.force_n)]
    return FLEXIBILITY_M_N * found


def peaks_hz(hits: Sequence[Hit]) -> tuple[np.ndarray, float]:
    """Return the frequencies at which the response has a peak, and up to where the force excites
    it, Hz. The response is tapered: the end of a record would add peaks."""
    length = 2 * max(len(hit.force_n) for hit in hits)
    across, own = np.zeros(length // 2 + 1, complex), np.zeros(length // 2 + 1)
    for hit in hits:
        after = np.maximum(np.arange(len(hit.response)) - hit.first, 0) / len(hit.response)
        force = np.fft.rfft(hit.force_n, length)
        across += np.conj(force) * np.fft.rfft(np.exp(-_TAPER * after) * hit.response, length)
        own += np.abs(force) ** 2
    hz = np.fft.rfftfreq(length, hits[0].interval_s)
    weak = own < _EXCITED * np.max(own)
    end = int(np.argmax(weak)) if weak[1:].any() else len(hz)
    level = np.log10(np.abs(across[1:end]) / own[1:end] + 1e-300)
    found = scipy.signal.find_peaks(level, prominence=_PROMINENT)[0]
    return hz[1:end][found], float(hz[end - 1])


def response_errors(modelled: np.ndarray, measured: np.ndarray) -> tuple[float, float]:
    """Return the error of modelled values: rms over rms, and largest over largest."""
    apart = np.abs(modelled - measured)
    rms = math.sqrt(float(np.mean(apart**2) / np.mean(np.abs(measured) ** 2)))
    return rms, float(np.max(apart) / np.max(np.abs(measured)))
