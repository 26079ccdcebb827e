"""Hypothesis strategies for runs of the controller."""

import math
from typing import Any

from hypothesis import strategies as st

from hertzloop.controller.controller import SignalPath
from tests.controller.specs import LawSpec

# Few distinct values make long contacts, repeated values and short gaps likely; the others
# try values in general. Three decimals keep p^1.5 away from underflow.
_FEW = st.sampled_from([-2.0, -1.0, -0.5, -0.0, 0.0, 0.5])
VALUES = st.one_of(_FEW, st.floats(-3.0, 1.0).map(lambda x: round(x, 3)))
SEQUENCES = st.lists(VALUES, min_size=1, max_size=60)
THRESHOLDS = st.sampled_from([-2.0, -0.25, 0.0, 0.4])
LEVELS = st.sampled_from([0.0, 0.25, -0.25])
LEADS = st.sampled_from([0, 0, 1, 3])
PROFILES = st.lists(st.sampled_from([0.0, 1.5, -2.0]), max_size=6).map(tuple)


def _threshold_laws(
    law: str, kappas: st.SearchStrategy[float], **more: st.SearchStrategy[Any]
) -> st.SearchStrategy[LawSpec]:
    return st.builds(
        LawSpec, st.just(law), st.just(3.7), kappas, THRESHOLDS, contact_level=LEVELS, **more
    )


LAWS = st.one_of(
    _threshold_laws("slope_threshold", st.sampled_from([0.8, -0.4]), lead_samples=LEADS),
    st.builds(
        LawSpec,
        st.sampled_from(["profile", "constant"]),
        st.just(1.0),
        profile_n=PROFILES,
        contact_level=LEVELS,
        lead_samples=LEADS,
    ),
    _threshold_laws("least_squares", st.just(0.8), window=st.sampled_from([2, 3, 5])),
    _threshold_laws(
        "fade_out",
        st.just(0.8),
        window=st.sampled_from([2, 3, 5]),
        fade_samples=st.sampled_from([0, 1, 4]),
    ),
    _threshold_laws(
        "predicted",
        st.just(0.8),
        lead_samples=st.sampled_from([1, 2, 5]),
        window=st.sampled_from([2, 4]),
        watch_level=st.sampled_from([-1.0, 0.5, 2.0]),
        mass_kg=st.sampled_from([0.5, 20.0]),
        impedance_n_s_m=st.sampled_from([1.0, math.inf]),
    ),
    st.builds(
        LawSpec,
        st.sampled_from(["force_feedback", "acceleration_feedback"]),
        st.just(1.0),
        gain=st.sampled_from([2.0, -0.5]),
        leak_hz=st.sampled_from([0.0, 0.1]),
    ),
    st.just(LawSpec("off", 1.0)),
)

# All that a line can do, except latency, which tests want to choose.
_CONVERTERS = st.sampled_from([(None, None), (None, 2.0), (4, 2.0), (12, 9.0)])
LINES = st.builds(
    lambda jitter, loss, converter, slew, tick: SignalPath(
        jitter_steps=jitter,
        drop_out_probability=loss,
        bits=converter[0],
        full_scale_n=converter[1],
        slew_n_s=slew,
        tick_steps=tick,
        first_tick_steps=0.4 * tick,
    ),
    st.sampled_from([0, 0, 1, 5]),
    st.sampled_from([0.0, 0.0, 0.3]),
    _CONVERTERS,
    st.sampled_from([None, None, 0.8]),
    st.sampled_from([0.0, 0.0, 0.97, 3.1]),
)
LATENCIES = st.integers(0, 6)
EVERY_STEPS = st.integers(1, 3)
CUTS = st.lists(st.integers(1, 60), max_size=12)
