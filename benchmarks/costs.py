"""What a plant step and an exchange cost on this machine."""

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple

import numpy as np

from benchmarks import integrator_kernels as ik
from benchmarks.program import OutDirOption, QuickOption, start
from benchmarks.results import results_in
from benchmarks.scenes import load
from benchmarks.timing import Cost, in_turn, timed
from hertzloop.bus.port import PeerLost
from hertzloop.bus.sockets import mesh_endpoints, on_loopback, reserved_ports
from hertzloop.bus.streams import CONTROLLER, PLANT, ROLES, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.state_kernels import FLIGHT_X

ROUNDS = 9
_STEPS, _TRIPS = 600, 400
_PAYLOAD = bytes(100)  # about a block with one sample, or its answer
_STOP = b"stop"
_PATIENCE_S = 300.0  # of an echo, while others are measured
_NAME = "costs"  # of the bus


def plant_case(plant: Plant, *, contact: bool) -> Callable[[], float]:
    """Steps within the first contact, or in flight over a plate that still rings."""
    ik.plant_steps(plant.model, plant.state, 0.0, 100)
    if not contact:
        plant.state.body[FLIGHT_X] += 1.0
        ik.plant_steps(plant.model, plant.state, 0.0, 2)
    kept = [array.copy() for array in plant.state]

    def measure() -> float:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        return timed(lambda: ik.plant_steps(plant.model, plant.state, 0.0, _STEPS), _STEPS)

    return measure


def two_pass_case(frequencies: int) -> Callable[[], float]:
    z, grown = np.zeros(frequencies, complex), np.full(frequencies, 1e-6 + 1e-6j)
    turn = np.exp(1j * np.linspace(0.01, 3.0, frequencies))
    return lambda: timed(lambda: ik.two_pass_steps(z, turn, grown, _STEPS), _STEPS)


def step_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per step of the plant kernels on `aluminium-20mm`, with all frequencies up to pi/dt and
    with as many as an accuracy asks for; yardstick: a plain two-pass loop over all of them."""
    cases: dict[str, Callable[[], float]] = {}
    for accuracy in ("1e-9", "1e-3", "1e-2"):
        spec = load("aluminium-20mm", [f"run.accuracy={accuracy}", "run.lead_in_s=0"]).plant
        count = len(ModalPlant(spec).modes.omega)
        if not cases:
            cases[f"two-pass loop, {count} frequencies"] = two_pass_case(count)
        for name, contact in (("flight", False), ("contact", True)):
            cases[f"{name}, {count} frequencies"] = plant_case(ModalPlant(spec), contact=contact)
    return in_turn(cases, rounds)


def _echo_zenoh(listen: list[str], connect: list[str]) -> None:
    port = ZenohPort(CONTROLLER, _NAME, listen, connect, None)
    port.liveliness.announce()
    port.liveliness.wait_for([PLANT], _PATIENCE_S)
    try:
        while (envelope := port.receive(_PATIENCE_S, "a message to echo")).payload != _STOP:
            port.publish(Envelope("force", envelope.payload))
    except PeerLost:
        pass
    port.close()


@contextmanager
def child(target: Callable[..., None], *arguments: object) -> Iterator[None]:
    """Another process that runs a function meanwhile; killed if it does not end in time."""
    process = multiprocessing.get_context("spawn").Process(
        target=target, args=arguments, daemon=True
    )
    process.start()
    try:
        yield
    finally:
        process.join(5.0)
        process.kill()


@contextmanager
def _zenoh() -> Iterator[Callable[[], float]]:
    """Round trips through the zenoh port to another process on loopback."""
    with reserved_ports(len(ROLES)) as ports:
        endpoints = on_loopback(ports)
        with child(_echo_zenoh, *mesh_endpoints(CONTROLLER, endpoints)):
            port = ZenohPort(PLANT, _NAME, *mesh_endpoints(PLANT, endpoints), None)
            port.liveliness.announce()
            port.liveliness.wait_for([CONTROLLER], 30.0)

            def trips() -> None:
                for _ in range(_TRIPS):
                    port.publish(Envelope("daq", _PAYLOAD))
                    port.receive(10.0, "the echo")

            yield lambda: timed(trips, _TRIPS)
            port.publish(Envelope("daq", _STOP))
            port.liveliness.wait_until_gone(CONTROLLER, 5.0)
            port.close()


def exchange_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per round trip of 100 B between two processes."""
    with _zenoh() as zenoh:
        return in_turn({"zenoh port": zenoh}, rounds)


def measure(rounds: int) -> dict[str, list[Cost]]:
    """Costs by group."""
    return {
        "plant step (us)": step_costs(rounds),
        "exchange (us per round trip of 100 B)": exchange_costs(rounds),
    }


def main(folder: OutDirOption = None, quick: QuickOption = False) -> None:
    """Measure what a plant step and an exchange cost on this machine.

    Example: python -m benchmarks.costs --quick
    """
    with results_in(folder, "costs", "modal") as results:
        groups = measure(2 if quick else ROUNDS)
        rows = [(group, *astuple(cost)) for group, costs in groups.items() for cost in costs]
        results.write_rows("costs", ("group", "case", "median_us", "least_us", "ratio"), rows)
        columns = {
            "case": "{.case}",
            "median": "{.median_us:.3g}",
            "least": "{.least_us:.3g}",
            "ratio": "{.ratio:.3g}",
        }
        for group, costs in groups.items():
            results.table(group, columns, costs)
        steps, exchanges = groups.values()
        step = next(cost for cost in steps if cost.case.startswith("contact"))
        results.conclude(
            f"A step in contact over {step.case.split()[-2]} frequencies takes "
            f"{step.median_us:.3f} us, and an exchange over zenoh {exchanges[0].median_us:.0f} us."
        )


if __name__ == "__main__":
    start("benchmarks.costs")
