"""All that `bench` measures, group by group."""

from dataclasses import asdict

from studies.cost.baseline import exchange_costs, loop_costs, step_costs, stranger_costs
from studies.cost.cases import mode_file_costs
from studies.cost.links import certificate_costs, link_costs, opening_costs


def measure() -> dict[str, list[dict[str, object]]]:
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
