"""The command `bench`."""

from dataclasses import asdict
from typing import Annotated

import typer

from hertzloop.cli import options, outputs, prepare
from hertzloop.cli.terminal import out, progress
from hertzloop.processes import fork_server
from hertzloop.scene.loading import DEFAULT
from hertzloop.studies.bench import bench as bench_study
from hertzloop.views.format import Table

_TRANSPORT_WORDS = {
    "compiled": "one compiled call",
    "inprocess": "one process, with messages",
    "zenoh": "three processes over zenoh",
}


def bench(
    scene: options.SceneArgument = DEFAULT,
    settings: options.SetOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="Measure fewer rounds and cases.")] = False,
    json_file: options.JsonOption = None,
) -> None:
    """Measure how fast this computer runs a scene.

    It times the loop in each transport, and the cases of a small sweep on one core.
    """
    outputs.check_json(json_file)
    resolved = prepare.scene_from(scene, settings, None)
    prepare.compile_first(resolved)

    fork_server.prepare()  # before anything starts a thread
    with progress("bench", 100) as advance:
        found = bench_study.measure(
            resolved, quick, lambda done, of: advance(round(100 * done / of))
        )
    title = f"{found.scene}: {found.steps:,} steps, {found.rounds} rounds"
    right = ("us a step, median", "least", "times real time")
    table = Table("loop", right=right, title=title)
    for loop in found.loops:
        table.add_row(
            _TRANSPORT_WORDS[loop.transport],
            f"{loop.median_us:.3g}",
            f"{loop.least_us:.3g}",
            f"{loop.times_real_time:.3g}",
        )
    out.print(table)
    out.print(
        f"sweep over {found.sweep.cases} latencies on one core: {found.sweep.per_s:z.0f} cases a "
        f"second (median), {found.sweep.most_per_s:z.0f} in the fastest round"
    )
    by = {loop.transport.value: loop for loop in found.loops}
    out.say(
        f"Over zenoh the loop takes {by['zenoh'].median_us:.3g} us a step, "
        f"{by['zenoh'].times_real_time:.2g} times real time, and one core runs "
        f"{found.sweep.per_s:z.0f} cases of a latency sweep in a second."
    )
    outputs.write_json(json_file, asdict(found))
