"""Against the plate's velocity at the contact point, in shares of the plate's impedance."""

from hertzloop.controller.law import LawContext
from hertzloop.controller.laws.force_feedback import (  # noqa: F401
    Constants,
    Parameters,
    State,
    command,
    force_bound,
    transfer_function,
    tune,
)

senses = "v_p"


def prepare(keys, about: LawContext) -> Constants:
    """Constants of the function."""
    return Constants(-keys.kappa * about.impedance_n_s_m)
