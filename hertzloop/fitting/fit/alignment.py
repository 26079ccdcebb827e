"""Find the touch in a record by correlation with a simulated one."""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.channel import Channel
from hertzloop.fitting.fit.channel_preparation import ONSET_LEVELS, ONSET_SHARE
from hertzloop.fitting.fit.simulated_impact import ObservedSignal

_WINDOW = (-0.5, 1.6)  # of a contact, in which a record is aligned
_FEWEST_ALIGNED, _MOST_ALIGNED = 4, 600  # samples
_LEAST_GAIN, _MOST_GAIN = 1 / 3, 3.0
_LATE = 0.1  # of the time of a wave from the contact to the sensor, that a scene may be off
_ALIKE = 0.3  # of the power, that a simulation may leave of a record
_MOST_SHIFTS = 1500  # of a search through a whole record


def align(channel: Channel, observed: ObservedSignal, contact_s: float) -> None:
    """Find the touch, gain and offset of a channel by correlation with a simulated record.

    Raises:
        RecordError: the record has too few samples in the contact, or its gain or sign say that
            unit, sensitivity or sign are wrong.
    """
    record = channel.record
    kept_s = channel.time_s[channel.kept]
    shortest_s = np.min(
        kept_s[_FEWEST_ALIGNED - 1 :] - kept_s[: 1 - _FEWEST_ALIGNED], initial=math.inf
    )
    if shortest_s >= (_WINDOW[1] - _WINDOW[0]) * contact_s:
        raise _too_coarse(channel, contact_s)
    guess_s, reach_s, late_s = _first_guess(channel, observed, contact_s)
    search = _ShiftSearch(channel, observed, contact_s, late_s)
    step_s = max(0.25e-6, contact_s / 120.0)
    best = search.best(guess_s, reach_s, step_s)
    known_gain = math.isfinite(record.measurement.sensitivity_uncertainty)
    if best is not None and known_gain and not best.mirrored and not best.likely_gain:
        # A few spikes in a row can look like the onset: look everywhere, then closer.
        middle_s = 0.5 * float(channel.time_s[0] + channel.time_s[-1])
        half_s = 0.5 * float(channel.time_s[-1] - channel.time_s[0])
        rough_s = max(contact_s / 15.0, 2.0 * half_s / _MOST_SHIFTS)
        other = search.best(middle_s, half_s, rough_s)
        if other is not None and other.left < _ALIKE and not other.mirrored and other.likely_gain:
            best = search.best(other.touch_s, 2.0 * rough_s, step_s)
    if best is None:
        raise _too_coarse(channel, contact_s)
    if best.gain < 0.0 or best.mirrored:
        raise RecordError(
            f"{record.name}: the record has the opposite sign of the simulation. Give "
            f"record.sensitivity = {-record.measurement.sensitivity:g}, or change the sign."
        )
    if known_gain and not best.likely_gain:
        raise RecordError(
            f"{record.name}: the record is {best.gain:.3g} times the simulation. Check "
            "record.unit, record.sensitivity, the starting values of the scene, and that time_s is "
            "in seconds. Of an unknown sensitivity, write record.sensitivity_uncertainty = inf."
        )
    channel.touch_s, channel.gain, channel.offset = best.touch_s, best.gain, best.offset


def _first_guess(
    channel: Channel, observed: ObservedSignal, contact_s: float
) -> tuple[float, float, float]:
    """Guess the touch from the onset of a channel.

    Returns:
        The touch, s; how far from it to search, s; and from the touch to the time that the window
        of the comparison is moved by, s, for a signal that comes later.
    """
    ringing_s = observed.chain.before_s  # a brick wall shows the impact before the touch
    grid_s = observed.spline.x if ringing_s else observed.simulated.time_s
    fine = observed.value(grid_s)
    first = grid_s <= 2.0 * contact_s
    shown = float(np.max(np.abs(fine[first])))
    if shown == 0.0:
        shown = float(np.max(np.abs(fine)))
    # An interval that is longer than the contact is that of another part of the record.
    reach_s = max(8e-6, 3.0 * min(channel.interval_s, contact_s), 0.35 * contact_s)
    reach_s = max(reach_s, 0.5 * ringing_s)
    late_s, share = 0.0, ONSET_SHARE
    if channel.record.quantity == "actuator_force" or channel.away_from_contact:
        # The signal may come after the contact.
        shown = float(np.max(np.abs(fine)))
        if channel.away_from_contact:
            share = max(share, ONSET_LEVELS * channel.noise_over_peak)
        late_s = max(0.0, float(grid_s[np.argmax(np.abs(fine) > share * shown)]))
        reach_s = max(reach_s, _LATE * late_s)
    if channel.is_gap:
        return channel.onset_s, reach_s, late_s
    if channel.has_quiet_start:
        early = np.abs(fine) > share * shown
        return channel.onset_s - float(grid_s[np.argmax(early)]), reach_s, late_s
    return float(channel.time_s[0]) - 0.2 * contact_s, 1.5 * contact_s, late_s


class _Match(NamedTuple):
    """A comparison at the best touch.

    Attributes:
        left: share of the record's power that the simulation leaves.
        touch_s: time of the touch, s.
        gain: record over simulation.
        offset: of the record.
        mirrored: whether a negative gain fits better by far.
    """

    left: float
    touch_s: float
    gain: float
    offset: float
    mirrored: bool

    @property
    def likely_gain(self) -> bool:
        """Whether the gain is one that unit and sensitivity of the record allow."""
        return _LEAST_GAIN <= self.gain <= _MOST_GAIN


class _ShiftSearch(NamedTuple):
    """A search for the touch by shifting a simulated record over a measured one.

    Attributes:
        channel: the measured record.
        observed: the simulated one.
        contact_s: contact time, s.
        late_s: from the touch to the contact time that the window begins around, s.
    """

    channel: Channel
    observed: ObservedSignal
    contact_s: float
    late_s: float

    def best(self, guess_s: float, reach_s: float, step_s: float) -> _Match | None:
        """Return the best match within `reach_s` of a guess, in steps of `step_s`; None if too few
        samples can be compared."""
        found: _Match | None = None
        turned = math.inf
        for shift in np.arange(-reach_s, reach_s + step_s, step_s):
            one = self._match(guess_s + float(shift))
            if one is None:
                continue
            if one.gain < 0.0:
                turned = min(turned, one.left)
            elif found is None or one.left < found.left:
                found = one
        if found is None:
            return None if turned == math.inf else _Match(turned, guess_s, -1.0, 0.0, True)
        return found._replace(mirrored=turned < 0.3 * found.left and turned < 0.2)

    def _match(self, touch_s: float) -> _Match | None:
        """Compare both records at a touch; None of too few samples, or without a signal."""
        channel = self.channel
        tau = channel.time_s - touch_s
        after_s = tau - self.late_s
        window = channel.kept & (after_s > _WINDOW[0] * self.contact_s)
        window &= after_s < _WINDOW[1] * self.contact_s
        where = np.flatnonzero(window)
        if len(where) < _FEWEST_ALIGNED:
            return None
        if len(where) > _MOST_ALIGNED:
            where = where[:: len(where) // _MOST_ALIGNED + 1]
        model, y = self.observed.value(tau[where]), channel.value[where]
        mean, of_y = float(np.mean(model)), float(np.mean(y))
        power = float(np.sum((model - mean) ** 2))
        shown = float(np.mean((y - of_y) ** 2))
        if power == 0.0 or shown == 0.0:  # of a converter that stays at one level
            return None
        gain = float(np.sum((model - mean) * (y - of_y))) / power
        left = float(np.mean((y - of_y - gain * (model - mean)) ** 2)) / shown
        return _Match(left, touch_s, gain, of_y - gain * mean, False)


def _too_coarse(channel: Channel, contact_s: float) -> RecordError:
    return RecordError(
        f"{channel.record.name}: too few samples are in the contact of {1e6 * contact_s:.3g} us, "
        f"at {1e6 * channel.interval_s:.3g} us from sample to sample. Record at a higher rate, and "
        "check that time_s is in seconds; if it is not, name the column time_us, for example."
    )
