"""What a plant step, an exchange and the whole loop cost on this machine.

Also what it costs to keep other users of a host off the bus: Unix sockets in a private folder, and
certificates made on the fly, against ports on loopback.
"""

import importlib.util
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks import roofline
from benchmarks.baseline import (
    NAME,
    ROUNDS,
    Cost,
    Meets,
    exchange_costs,
    in_turn,
    loop_costs,
    on_ports,
    over_zenoh,
    step_costs,
    stranger_costs,
    timed,
)
from benchmarks.cases import mode_file_costs
from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    compile_first,
    conclude,
    fail,
    number_table,
    out,
    results_in,
    start,
    write_json,
    written,
)
from hertzloop.bus.port import BusError
from hertzloop.bus.sockets import LOOPBACK, on_loopback, own_endpoints, reserved_ports
from hertzloop.bus.streams import PLANT, ROLES
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.processes.launcher import RunFailed
from hertzloop.studies.words import write_rows
from hertzloop.views.format import Table

_OPENED = 3
_PAUSE_S = 0.05  # after a session: what closes it must not be counted with the next


@contextmanager
def ways() -> Iterator[dict[str, Meets]]:
    """All that are possible here, each with endpoints of its own; loopback first."""
    with ExitStack() as stack:
        loopback = on_loopback(stack.enter_context(reserved_ports(len(ROLES))))
        found = {"loopback": on_ports(loopback)}
        sockets = stack.enter_context(own_endpoints())
        if sockets[0].startswith("unixsock"):
            found["Unix sockets"] = on_ports(sockets)
        if importlib.util.find_spec("cryptography"):
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            numbers = stack.enter_context(reserved_ports(len(ROLES)))
            files = _certified(folder, numbers)
            found["TLS on loopback"] = lambda role: ([], [], files[role])
        yield found


def _certified(folder: Path, ports: list[int]) -> dict[str, Path]:
    """Configurations with certificates of an authority that is forgotten at once."""
    from hertzloop.certificates import CertificateAuthority, configurations

    places = {role: (LOOPBACK, port) for role, port in zip(ROLES, ports, strict=True)}
    files = {role: folder / f"{role}.json5" for role in ROLES}
    for role, configuration in configurations(CertificateAuthority(days=1), places).items():
        files[role].touch(mode=0o600)
        files[role].write_text(json.dumps(configuration))
    return files


def link_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per round trip of 100 B through the zenoh port, by each way; yardstick: loopback."""
    with ExitStack() as stack:
        found = stack.enter_context(ways())
        cases = {name: stack.enter_context(over_zenoh(meets)) for name, meets in found.items()}
        return in_turn(cases, rounds)


def opening_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us to open a port, certificates not counted; yardstick: loopback."""

    def case(meets: Meets) -> Callable[[], float]:
        def measure() -> float:
            spent = 0.0
            for _ in range(_OPENED):
                started = time.perf_counter()
                port = ZenohPort(PLANT, NAME, *meets(PLANT))
                spent += 1e6 * (time.perf_counter() - started)
                port.close()
                time.sleep(_PAUSE_S)
            return spent / _OPENED

        return measure

    with ways() as found:
        return in_turn({name: case(meets) for name, meets in found.items()}, rounds)


def certificate_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us to make what a run by certificates needs: an authority, and one for each role."""
    if not importlib.util.find_spec("cryptography"):
        return []
    with tempfile.TemporaryDirectory() as folder:
        ports = list(range(1, 1 + len(ROLES)))  # nobody listens there
        cases = {"TLS, certificates": lambda: timed(lambda: _certified(Path(folder), ports), 1)}
        return in_turn(cases, rounds)


def measure() -> dict[str, list[dict[str, Any]]]:
    """Costs by group, as plain data."""
    groups = {
        "plant step (us)": step_costs(),
        "plate by its modes (us per step)": mode_file_costs(),
        "exchange (us per round trip of 100 B)": exchange_costs(),
        "ways on one host (us per round trip of 100 B)": link_costs(),
        "opening a port (us)": opening_costs() + certificate_costs(),
        "whole loop (us per step)": loop_costs(),
        "beside strangers (us per step)": stranger_costs(),
    }
    return {name: [asdict(cost) for cost in costs] for name, costs in groups.items()}


def measure_quickly() -> dict[str, list[dict[str, Any]]]:
    """Costs of the groups that take seconds, in one round each, as plain data."""
    groups = {
        "plant step (us)": step_costs(2),
        "exchange (us per round trip of 100 B)": exchange_costs(2),
    }
    return {name: [asdict(cost) for cost in costs] for name, costs in groups.items()}


def cost_table(title: str, costs: list[dict[str, Any]]) -> Table:
    """Measured costs of a group; the first case is the yardstick."""
    return number_table(
        title,
        ("case", "median", "least", "ratio"),
        (
            (cost["case"], *(f"{cost[key]:.3g}" for key in ("median_us", "least_us", "ratio")))
            for cost in costs
        ),
        text=1,
    )


def roofline_table(title: str, shares: list[dict[str, Any]]) -> Table:
    """What the parts of a step reach of the processor's peaks; rows of `benchmarks.roofline`."""
    rows = []
    for one in shares:
        floor, alone, step = (one[key] for key in ("floor_us", "pass_us", "step_us"))
        rows.append((
            one["case"].rsplit(", ", 1)[0], str(one["frequencies"]), f"{floor:.3f}",
            f"{alone:.3f}", f"{floor / alone:.0%}", f"{step:.3f}", f"{floor / step:.0%}",
            f"{one['of_two_pass']:.2f}",
        ))  # fmt: skip
    headings = ("case", "modes", "floor us", "pass us", "share", "step us", "share", "loops")
    table = number_table(title, headings, rows, text=1)
    rates = [one["gigabytes_s"] for one in shares]
    table.caption = (
        f"peaks: {shares[0]['gigaoperations_s']:.1f} G multiply-adds/s, {min(rates):.0f} to "
        f"{max(rates):.0f} GB/s; share: of the floor; loops: step in two-pass loops over 1104"
    )
    return table


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Measure what a plant step, an exchange and the whole loop cost on this machine.

    Also measures the ways of a bus on one host, a run beside a listener that does not keep up, and
    how close the step comes to the limits of the processor. With --quick: step and exchange only.

    Example: python -m benchmarks.costs --quick
    """
    check_json(json_file)
    with results_in(folder, "costs") as made:
        compile_first()
        try:
            data = measure_quickly() if quick else measure()
            shares = [asdict(one) for one in roofline.shares(*((5,) if quick else ()))]
        except (RunFailed, BusError) as error:
            fail(str(error), 1)
        header = ["group", "case", "median_us", "least_us", "ratio"]
        flat = [[group, *cost.values()] for group, costs in data.items() for cost in costs]
        write_rows(made / "costs.csv", header, flat)
        write_rows(made / "roofline.csv", list(shares[0]), (list(one.values()) for one in shares))
        sizes = [(f"{row[1]}", float(str(row[2]))) for row in flat]
        bars(made / "costs.png", "Costs on this machine", "us, median", sizes, log=True)
    for title, costs in data.items():
        out.print(cost_table(title, costs))
    out.print(roofline_table("roofline of the default scheme's step", shares))
    written(made, "costs.csv", "roofline.csv", "costs.png")
    step = next(one for one in shares if str(one["case"]).startswith("contact"))
    part = float(str(step["floor_us"])) / float(str(step["step_us"]))
    trip = data["exchange (us per round trip of 100 B)"][1]
    conclude(
        f"A step in contact over {step['frequencies']} frequencies takes {step['step_us']:.3f} us, "
        f"{part:.0%} of the speed that memory and arithmetic permit, and an exchange over zenoh "
        f"{trip['median_us']:.0f} us."
    )
    write_json(json_file, {**data, "roofline": shares})


if __name__ == "__main__":
    start("benchmarks.costs")
