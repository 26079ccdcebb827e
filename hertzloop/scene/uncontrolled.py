"""The contact force of the first impact without control, which some laws ask for."""

from functools import lru_cache

import numpy as np

from hertzloop.closed_loop.parts import series_under
from hertzloop.controller.loading.law import LawError
from hertzloop.plant import time_series as ts
from hertzloop.plant.metrics.impacts import contacts
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.build import build_plant
from hertzloop.scene.scene import Scene
from hertzloop.scene.setup import Setup, resolve

# Steps after the lead-in in which the first contact without control is looked for, four times as
# many at a time; the published scheme's work grows with their square.
_FIRST_STEPS = 1 << 10
_MOST_STEPS, _MOST_PUBLISHED = 1 << 20, 1 << 14


def uncontrolled_force_n(setup: Setup) -> np.ndarray:
    """Return the contact force of the first impact without control, from the sample at its start,
    N; in the published scheme its elastic part; shape (samples in contact,).

    Raises:
        LawError: the contact lasts longer than is worth following.
    """
    found, followed_s = _uncontrolled_force_n(setup.without_control().plant_only())
    if found is None:
        raise LawError(
            f"controller.law = '{setup.scene.controller.law}' needs the contact force without "
            f"control, but the first contact does not end within {followed_s:g} s. Use a harder "
            "plate, less contact.viscous_n_s_m, or another law."
        )
    return found


@lru_cache(maxsize=16)
def _uncontrolled_force_n(alone: Scene) -> tuple[np.ndarray | None, float]:
    """The force, None of a contact that lasts too long; how long it was followed, s."""
    free = resolve(alone)
    published = not SCHEMES[free.run.scheme].conserves
    steps, lead_s = _FIRST_STEPS, free.run.lead_in_s
    while steps <= (_MOST_PUBLISHED if published else _MOST_STEPS):
        run = free.run.replaced(duration_s=lead_s + steps * free.run.step_s)
        short = resolve(alone.replaced(run=run))
        truth = series_under(build_plant(short), np.zeros(1), short.run.steps)
        found = first_contact_force_n(truth, free.mechanics.contact.stiffness, published)
        if found is not None:
            return found, steps * free.run.step_s
        steps *= 4
    return None, steps / 4 * free.run.step_s


def first_contact_force_n(
    truth: np.ndarray, stiffness: float, published: bool
) -> np.ndarray | None:
    """Contact force of the first contact from its first sample on, N; its elastic part in the
    published scheme, as there. None unless the contact has ended.

    Args:
        truth: rows of a plant, shape (10, steps).
        stiffness: of the contact, N/m^1.5.
    """
    gap = truth[ts.XI]
    # The published scheme starts a contact at xi = 0, where its force is still zero.
    starts, ends = contacts((gap <= 0.0).astype(float) if published else truth[ts.F_C])
    if not ends:
        return None
    span = slice(starts[0], ends[0])
    if published:
        depth = np.maximum(-gap[span], 0.0)
        return np.asarray(stiffness * depth * np.sqrt(depth))  # not **: it varies by processor
    return truth[ts.F_C, span].copy()
