"""Peaks of the response of hits, up to the frequency where their forces excite nothing."""

from collections.abc import Sequence

import numpy as np
import scipy

from hertzloop.fitting.modes.hit_responses import HitResponse

_TAPER = 5.0  # decay within a record, as an exponent: the end of a record would add peaks
_HEIGHT = 0.15  # least height of a peak: 3 dB, as a logarithm
_EXCITED = 1e-3  # least square of an exciting force, over its largest


def response_peaks(hits: Sequence[HitResponse]) -> tuple[int, float]:
    """Return the number of peaks of the response, and up to which frequency (Hz) they count."""
    length = 2 * max(len(hit.force_n) for hit in hits)
    cross, own = np.zeros(length // 2 + 1, complex), np.zeros(length // 2 + 1)
    for hit in hits:
        after = np.maximum(np.arange(len(hit.response)) - hit.first, 0) / len(hit.response)
        force = np.fft.rfft(hit.force_n, length)
        cross += np.conj(force) * np.fft.rfft(np.exp(-_TAPER * after) * hit.response, length)
        own += np.abs(force) ** 2
    hz = np.fft.rfftfreq(length, hits[0].interval_s)
    weak = own < _EXCITED * np.max(own)
    end = int(np.argmax(weak)) if weak[1:].any() else len(hz)
    level = np.log10(np.abs(cross[1:end]) / own[1:end] + 1e-300)
    peaks = scipy.signal.find_peaks(level, prominence=_HEIGHT)[0]
    return len(peaks), float(hz[end - 1])
