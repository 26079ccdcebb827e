"""Hypothesis strategies for runs of the controller."""

import math

from hypothesis import strategies as st

from controller.controller import Law, LawSpec, LineSpec

# Few distinct values make long contacts, repeated values and short gaps likely; the others
# try values in general. Three decimals keep p^1.5 away from underflow.
_FEW = st.sampled_from([-2.0, -1.0, -0.5, -0.0, 0.0, 0.5])
VALUES = st.one_of(_FEW, st.floats(-3.0, 1.0).map(lambda x: round(x, 3)))
SEQUENCES = st.lists(VALUES, min_size=1, max_size=60)
THRESHOLDS = st.sampled_from([-2.0, -0.25, 0.0, 0.4])
LEVELS = st.sampled_from([0.0, 0.25, -0.25])
LEADS = st.sampled_from([0, 0, 1, 3])
PROFILES = st.lists(st.sampled_from([0.0, 1.5, -2.0]), max_size=6).map(tuple)

LAWS = st.one_of(
    st.builds(
        LawSpec,
        st.just(Law.SLOPE_THRESHOLD),
        st.just(3.7),
        st.sampled_from([0.8, -0.4]),
        THRESHOLDS,
        contact_level=LEVELS,
        lead_samples=LEADS,
    ),
    st.builds(
        LawSpec,
        st.sampled_from([Law.PROFILE, Law.CONSTANT]),
        st.just(1.0),
        profile_n=PROFILES,
        contact_level=LEVELS,
        lead_samples=LEADS,
    ),
    st.builds(
        LawSpec,
        st.just(Law.SLOPE_THRESHOLD),
        st.just(3.7),
        st.just(0.8),
        THRESHOLDS,
        contact_level=LEVELS,
        window=st.sampled_from([2, 3, 5]),
        fade_samples=st.sampled_from([None, 0, 1, 4]),
    ),
    st.builds(
        LawSpec,
        st.just(Law.PREDICTED),
        st.just(3.7),
        st.just(0.8),
        THRESHOLDS,
        contact_level=LEVELS,
        lead_samples=st.sampled_from([1, 2, 5]),
        window=st.sampled_from([2, 4]),
        watch_level=st.sampled_from([-1.0, 0.5, 2.0]),
        mass_kg=st.sampled_from([0.5, 20.0]),
        impedance_n_s_m=st.sampled_from([1.0, math.inf]),
    ),
    st.builds(
        LawSpec,
        st.sampled_from([Law.FEEDBACK, Law.INTEGRAL_FEEDBACK]),
        st.just(1.0),
        gain=st.sampled_from([2.0, -0.5]),
        leak_hz=st.sampled_from([0.0, 0.1]),
        dead_zone=st.sampled_from([0.0, 0.5]),
    ),
    st.just(LawSpec(Law.OFF, 1.0)),
)

# All that a line can do, except latency, which tests want to choose.
_CONVERTERS = st.sampled_from([(None, None), (None, 2.0), (4, 2.0), (12, 9.0)])
LINES = st.builds(
    lambda jitter, loss, converter, slew: LineSpec(
        jitter_steps=jitter,
        drop_out_probability=loss,
        bits=converter[0],
        full_scale_n=converter[1],
        slew_n_s=slew,
    ),
    st.sampled_from([0, 0, 1, 5]),
    st.sampled_from([0.0, 0.0, 0.3]),
    _CONVERTERS,
    st.sampled_from([None, None, 0.8]),
)
LATENCIES = st.integers(0, 6)
EVERY_STEPS = st.integers(1, 3)
CUTS = st.lists(st.integers(1, 60), max_size=12)
