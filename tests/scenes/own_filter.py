"""A force against the plate's velocity, low-passed: a linear law of one's own."""

from hertzloop.law import Field, Keys

senses = "v_p"


class Parameters(Keys):
    gain_n_s_m: float = Field(20.0, ge=0.0, le=1e4)


class State:
    smooth: float = 0.0


def command(p, s, samples, i):
    s.smooth += 0.3 * (samples[i] - s.smooth)
    return -p.gain_n_s_m * s.smooth
