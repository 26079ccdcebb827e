"""Hits as rows that modes are fitted to: what each mode would respond to their forces."""

from collections.abc import Sequence

import numpy as np
import scipy

from hertzloop.fitting.modes.hit_responses import HitResponse
from hertzloop.fitting.modes.response_rows import FLEXIBILITY_M_N, ResponseRows

_PASSED = 0.45  # highest frequency that a converter passes, over the sampling rate
_LOWEST_PERIODS = 0.5  # fewest periods of a mode within a record
_LEAST_WIDTH = 0.02  # least bandwidth of a mode, over the resolution of a record
_BLOCK = 64  # samples


def rows_of_hits(hits: Sequence[HitResponse], at_contact: bool) -> ResponseRows:
    """Return hits as rows that modes are fitted to.

    Args:
        hits: hits of one quantity and rate; their samples follow each other.
        at_contact: whether the response was measured at the point that is hit. It then has a
            residual flexibility, and no mode has a negative residue.
    """
    dt = hits[0].interval_s
    longest_s = max(len(one.force_n) for one in hits) * dt

    def basis(omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [one.apply_window(_mode_responses(one, omega, loss)) for one in hits], axis=1
        )

    values = np.concatenate([one.response for one in hits])[None]
    rest = np.concatenate([one.apply_window(_spring_response(one)) for one in hits])[None]
    return ResponseRows(
        basis=basis,
        rest=rest[: int(at_contact)],
        values=values,
        weights=np.full(values.shape, 1.0 / np.sqrt(np.mean(values**2))),
        band_hz=(_LOWEST_PERIODS / longest_s, _PASSED / dt),
        resolution_hz=1.0 / longest_s,
        drive=0 if at_contact else None,
        least_width_hz=_LEAST_WIDTH / longest_s,
    )


def _spectrum(hit: HitResponse) -> tuple[np.ndarray, np.ndarray, int]:
    """Spectrum of the force with as many zeros or more behind it, its angular frequencies (rad/s),
    and the number of samples with the zeros."""
    length = 2 * scipy.fft.next_fast_len(len(hit.force_n), real=True)
    return (
        np.fft.rfft(hit.force_n, length),
        2 * np.pi * np.fft.rfftfreq(length, hit.interval_s),
        length,
    )


def _mode_responses(hit: HitResponse, omega: np.ndarray, loss: np.ndarray) -> np.ndarray:
    """Responses from rest of modes of unit residue, (modes, samples).

    They are exact for a force without content above half the sampling rate: the response to the
    force repeated without end, less the free vibration that lets it begin at rest.
    """
    force, w, length = _spectrum(hit)
    count = len(hit.force_n)
    o, damping = omega[:, None], (loss * omega)[:, None]
    periodic = force / (o**2 - w**2 + 1j * damping * w)
    moved = 1j * w * periodic
    moved[:, -1] = 0.0  # A component at half the rate has no velocity.
    q, v = (_first_values(one) / length for one in (periodic, moved))
    s = omega * (-loss / 2.0 + 1j * np.sqrt(1.0 - loss**2 / 4.0))
    start = q - 1j * (v - s.real * q) / s.imag
    if hit.order == 2:
        moved = force - damping * moved - o**2 * periodic
    shown = np.fft.irfft(moved if hit.order else periodic, length)[:, :count]
    # The products of two short tables give exp(s t) faster than an exponential of each time.
    blocks = np.exp(s[:, None] * (hit.interval_s * _BLOCK * np.arange(-(-count // _BLOCK))))
    within = np.exp(s[:, None] * (hit.interval_s * np.arange(_BLOCK)))
    free = (start * s**hit.order)[:, None, None] * blocks[:, :, None] * within[:, None, :]
    return shown - free.real.reshape(len(omega), blocks.shape[1] * _BLOCK)[:, :count]


def _first_values(spectra: np.ndarray) -> np.ndarray:
    """First values of real series by their spectra, (modes, lines), times their length."""
    ends = spectra[:, 0] + spectra[:, -1]
    return np.asarray((2.0 * np.sum(spectra, axis=1) - ends).real)


def _spring_response(hit: HitResponse) -> np.ndarray:
    """Response of a spring of the unit flexibility, (samples,)."""
    force, w, length = _spectrum(hit)
    found = np.fft.irfft((1j * w) ** hit.order * force, length)[: len(hit.force_n)]
    return FLEXIBILITY_M_N * found
