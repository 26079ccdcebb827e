"""Choose the samples of a record that a fit uses, and their weights."""

import math

import numpy as np

from hertzloop.fitting.fit.channels.channel import Channel

LASTING_S = 0.06  # time after the impact that a fit uses
_UNKNOWN_CONTACTS = 1.6
_LONG_RUN = 8  # samples on one level, more than a slope makes
_MOST_SAMPLES = 60_000
_DENSE_CONTACTS = 12.0


def thin_samples(channel: Channel, contact_s: float) -> None:
    """Use every n-th sample of a very long record: more of those in the first contacts."""
    n = len(channel.time_s)
    if n <= _MOST_SAMPLES:
        return
    tau = channel.time_s - channel.touch_s
    dense = np.abs(tau) < _DENSE_CONTACTS * contact_s
    every = max(1, math.ceil((n - np.count_nonzero(dense)) / (0.7 * _MOST_SAMPLES)))
    keep_dense = max(1, math.ceil(np.count_nonzero(dense) / (0.3 * _MOST_SAMPLES)))
    index = np.arange(n)
    if keep_dense == 1:
        chosen = dense | (index % every == 0)
    else:
        chosen = np.where(dense, index % keep_dense == 0, index % every == 0)
    channel.time_s, channel.value = channel.time_s[chosen], channel.value[chosen]
    channel.kept = channel.kept[chosen]
    channel.ar, channel.innovation = np.empty(0), 1.0
    within = "all" if keep_dense == 1 else f"one in {keep_dense}"
    channel.notes.append(
        f"{channel.record.name}: of {n} samples {np.count_nonzero(chosen)} are used, {within} of "
        f"the first {_DENSE_CONTACTS:g} contact times and one in {every} beyond."
    )


def weight_equal_readings(channel: Channel) -> None:
    """Give the samples of a long run of equal readings together the weight of one sample.

    Where the noise is hidden in the steps of a converter, they share one error: the readings before
    the impact would fix the offset to a level of the converter, up to half a step from the truth.
    """
    if channel.equivalent_samples is None:
        return
    starts = np.flatnonzero(np.diff(channel.value, prepend=math.nan) != 0.0)
    lengths = np.diff(np.append(starts, len(channel.value)))
    each = np.repeat(np.where(lengths > _LONG_RUN, lengths, 1), lengths)
    channel.weight = 1.0 / np.sqrt(each)


def exclude_contact(channel: Channel, contact_s: float) -> None:
    """Leave the contact out of an acceleration without a filter, where the record goes on long
    enough: there it grows with the number of modes."""
    if not channel.contact_unknown or channel.duration_s < 4.0 * contact_s:
        return
    tau = channel.time_s - channel.touch_s
    channel.kept = channel.kept & ~((tau > -1e-6) & (tau < _UNKNOWN_CONTACTS * contact_s))


def cut_late_samples(channel: Channel) -> None:
    """Leave out samples later after the impact than a simulation is worth."""
    late = channel.time_s > channel.onset_s + LASTING_S
    if np.any(late):
        channel.kept = channel.kept & ~late
        keep = ~late
        channel.time_s, channel.value = channel.time_s[keep], channel.value[keep]
        channel.kept = channel.kept[keep]
        channel.notes.append(
            f"{channel.record.name}: {np.count_nonzero(late)} samples later than "
            f"{1e3 * LASTING_S:g} ms after the impact are not used."
        )
