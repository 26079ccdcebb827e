"""A share of the largest contact force so far, held while the force falls."""

from hertzloop.law import Field, Keys

senses = "contact_force"


class Parameters(Keys):
    share: float = Field(0.5, ge=-1.0, le=1.0)


class State:
    largest_n: float = 0.0


def command(p, s, samples, i):
    s.largest_n = max(0.9 * s.largest_n, samples[i])
    return p.share * s.largest_n
