"""The scheme `discrete_gradient`: order 2, a contact force that is constant over a step.

A scheme that hertzloop does not know, to compare its default scheme with, and an example of a
scheme of one's own: kernels with a model and a state, a subclass of `Plant` that makes both, and a
row for the table of schemes.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from benchmarks.schemes import discrete_gradient_kernels
from benchmarks.schemes.discrete_gradient_kernels import DiscreteModel
from hertzloop.plant.lanes import aligned
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.modal import poles_of
from hertzloop.plant.schemes.modal_kernels import BALANCE_SIZE, ModalState
from hertzloop.plant.schemes.registry import SCHEMES, Scheme
from hertzloop.plant.state_kernels import BODY_SIZE, COUNTS_SIZE, GRAVITY_M_S2
from hertzloop.plant.structures.linear import linear_of

NAME = "discrete_gradient"
SCHEME = Scheme(f"{__name__}:DiscreteGradientPlant")


@contextmanager
def known_to_scenes() -> Iterator[None]:
    """Let scenes name the scheme meanwhile: `run.scheme = "discrete_gradient"`."""
    SCHEMES[NAME] = SCHEME
    try:
        yield
    finally:
        del SCHEMES[NAME]


class DiscreteGradientPlant(Plant):
    """Model and state of the second-order scheme, driven by its kernels' `step`."""

    kernels: Any = discrete_gradient_kernels

    def _build_model(self) -> DiscreteModel:
        structure, contact = poles_of(self.spec, self.modes), self.spec.contact
        return DiscreteModel(
            step_s=self.spec.step_s,
            linear=linear_of(structure, self.spec.step_s),
            actuator=len(structure.drive) - 1,
            damped=bool(np.any(structure.poles.real < 0.0)),
            mass_kg=self.spec.sphere.mass_kg,
            gravity_m_s2=GRAVITY_M_S2,
            stiffness=contact.stiffness,
            viscous_n_s_m=contact.viscous_n_s_m,
            hunt_crossley_s_m=contact.hunt_crossley_s_m,
        )

    def _empty_state(self) -> ModalState:
        linear = self.model.linear
        points, forces = linear.direct.shape
        return ModalState(
            z=aligned(np.zeros_like(linear.turn)),
            force=np.zeros((forces, 2)),
            seen=np.zeros((points, 2)),
            before=np.zeros((points, 2)),
            body=np.zeros(BODY_SIZE),
            balance=np.zeros(BALANCE_SIZE),
            counts=np.zeros(COUNTS_SIZE, np.int64),
        )
