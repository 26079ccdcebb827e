"""The loop of a run in plain Python: plant, sensor, law and latency, step by step.

The samples have the bits of `hertzloop.simulate(scene)`, which is some hundred times as fast.
"""

from collections import deque

import hertzloop

LATENCY_STEPS = 2
scene = hertzloop.load(
    "aluminium-3mm",
    {
        "controller.law": "force_feedback",
        "controller.kappa": 0.4,
        "controller.latency_us": LATENCY_STEPS,
        "run.duration_s": 0.0013,
    },
)


def law(sample: float) -> float:
    """A share of the measured contact force, N."""
    return 0.4 * sample


plant = hertzloop.Stepper(scene)  # sphere, plate and actuator, with the sensor on them
on_the_way = deque([0.0] * (1 + LATENCY_STEPS))  # a command acts from the next step on, and later
samples = [plant.sample]
while plant.steps_done < plant.steps:
    on_the_way.append(law(samples[-1]))
    samples.append(plant.step(on_the_way.popleft()))

print(f"largest contact force: {max(samples):.1f} N")
print(f"energy from the actuator: {1e6 * plant.balance().injected_j:.1f} uJ")
