"""Damping parameters of the published scheme for a coefficient of restitution."""

from typing import Annotated

import typer

from benchmarks.program import OutDirOption, QuickOption, progress, start
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption, SceneArgument, SetOption
from hertzloop.cli.prepare import scene_from
from hertzloop.cli.terminal import fail, out
from paper.restitution import calibrate_relaxation, calibrate_viscous


def main(
    scene: SceneArgument = "thesis-aluminium",
    restitution: Annotated[
        float | None,
        typer.Option(
            help="Reach this ratio of relative velocities after and before the contact, by "
            "default the plate material's coefficient.",
            show_default=False,
        ),
    ] = None,
    relaxation_s: Annotated[
        float, typer.Option(min=1e-7, help="Use this time constant tau of the relaxation, s.")
    ] = 1e-3,
    settings: SetOption = None,
    folder: OutDirOption = None,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Find damping parameters of the published scheme for a coefficient of restitution.

    With --quick: the viscous damper only.

    Example: python -m paper.calibrate thesis-aluminium --restitution 0.7
    """
    resolved = scene_from(scene, settings, None)
    target = restitution or resolved.mechanics.structure.material.restitution
    data = {"restitution": target, "relaxation_s": relaxation_s}
    with results_in(folder, "calibrate", "thesis2008", json_file=json_file) as results:
        try:
            with progress("calibrate", 2) as advance:
                data["viscous_n_s_m"] = calibrate_viscous(resolved.plant, target)
                advance(1)
                if not quick:
                    data["relaxation_stiffness"] = calibrate_relaxation(
                        resolved.plant, target, relaxation_s
                    )
        except ValueError as error:
            fail(str(error), 2)
        results.write_rows("calibrate", list(data), [data.values()])
        results.add(**data)
        for key, value in data.items():
            out.print(f"{key} = {value:.8g}")
        results.conclude(
            f"A viscous damper of {data['viscous_n_s_m']:.4g} N s/m gives {resolved.scene.name} a "
            f"coefficient of restitution of {target:g}."
        )


if __name__ == "__main__":
    start("paper.calibrate")
