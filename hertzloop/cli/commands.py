"""The table of all commands, by panel of the help."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Leaf:
    """A command.

    Attributes:
        words: its words after `hertzloop`.
        function: "module:function", below hertzloop.cli if the name is not whole.
        summary: the first sentence of its help.
        example: an example of its use, without `hertzloop`.
    """

    words: str
    function: str
    summary: str
    example: str


MAIN = (
    Leaf(
        "run", "run:run", "Run and record a scene, and compare it with the same run without "
                          "control.",
        "run aluminium-3mm --set controller.latency_us=5",
    ),
    Leaf(
        "replay", "recordings:replay",
        "Watch a recording in slow motion beside the run without control.",
        "replay aluminium-20mm.mcap --save replay.rrd",
    ),
    Leaf(
        "sweep", "sweeps:sweep", "Simulate a scene over ranges of its keys.",
        "sweep aluminium-3mm --over controller.latency_us=0:20:1 --over sensors.bits=8,12,16",
    ),
    Leaf(
        "tune", "tune:tune", "Search for the law and the parameters with the best figures in "
                             "a scene.",
        "tune aluminium-20mm --law slope_threshold --law shifted_threshold --out-dir tuned",
    ),
    Leaf(
        "budget", "budget:budget",
        "Find how much latency and how few bits a law tolerates.",
        "budget aluminium-3mm --law slope_threshold --goal 'plate_energy_db <= -3' --quick",
    ),
    Leaf(
        "margin", "margin:margin", "Tell how stable a linear law's loop is in flight.",
        "margin aluminium-20mm --set controller.law=velocity_feedback --set controller.kappa=0.05",
    ),
    Leaf(
        "fit", "hertzloop.identification.commands.fit:fit",
        "Fit keys of a scene to measured records.",
        "fit aluminium-3mm drop.csv --free sphere.radius_m --json fit.json",
    ),
    Leaf(
        "report", "recordings:report", "Write an HTML report on a recording, a sweep or a tuning.",
        "report aluminium-20mm.mcap --out-dir pages",
    ),
)  # fmt: skip
RECORDINGS = (
    Leaf(
        "inspect", "recordings:inspect", "Check a recording and print its figures.",
        "inspect aluminium-20mm.mcap --json figures.json",
    ),
    Leaf(
        "compare", "recordings:compare",
        "Compare the bytes or the figures of two recordings.",
        "compare a.mcap b.mcap --figures",
    ),
    Leaf(
        "repair", "recordings:repair", "Recover a complete file from a truncated recording.",
        "repair broken.mcap --out whole.mcap",
    ),
    Leaf(
        "export", "export:export",
        "Write a recording's samples as CSV, Parquet, NPZ, HDF5 or MCAP.",
        "export aluminium-20mm.mcap --out samples.csv --from 0 --to 5",
    ),
    Leaf(
        "listen", "listen:listen", "Write the sound of a run, with and without control, as WAV.",
        "listen aluminium-20mm.mcap --out-dir sounds --slow 10",
    ),
)  # fmt: skip
SCENE = (
    Leaf("scene list", "scene:list_scenes", "List the shipped scenes.", "scene list"),
    Leaf("scene show", "scene:show", "Print a shipped scene as TOML.", "scene show aluminium-3mm"),
    Leaf(
        "scene new", "scene:new", "Write a commented scene that runs without changes.",
        "scene new mine.toml",
    ),
    Leaf(
        "scene keys", "scene:keys", "List the keys of a scene: values, unit, default, meaning.",
        "scene keys latency",
    ),
    Leaf(
        "scene check", "scene:check",
        "List the physical effects that a scene neglects, and the size of each.",
        "scene check aluminium-3mm",
    ),
    Leaf(
        "scene modes", "hertzloop.identification.commands.modes:modes",
        "Write modes as a table that a scene can read: of a plate, or measured ones.",
        "scene modes --from plate.unv --contact 12 --direction z --out modes.csv",
    ),
)  # fmt: skip
LAW = (
    Leaf("law list", "law:list_laws", "List the shipped laws and their keys.", "law list"),
    Leaf(
        "law new", "law:new", "Write a commented law in Python or C that runs without changes.",
        "law new mine.py",
    ),
    Leaf(
        "law replay", "law:replay",
        "Feed a recording's samples to another law and show where the forces differ.",
        "law replay aluminium-20mm.mcap --law shifted_threshold",
    ),
    Leaf(
        "law test", "law:controller_test",
        "Test your own controller program in short runs.",
        "law test --controller 'python my_controller.py {name} {listen} {connect}'",
    ),
)  # fmt: skip
NODE = (
    Leaf(
        "node plant", "node:plant", "Run the plant as a separate process.",
        "node plant aluminium-3mm --listen tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node controller", "node:controller", "Run the controller as a separate process.",
        "node controller --connect tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node recorder", "node:recorder", "Run the recorder as a separate process.",
        "node recorder --out run.mcap --connect tcp/10.0.0.1:7450",
    ),
    Leaf(
        "node watch", "watch:watch", "Show a run in progress without delaying it.",
        "node watch --save live.rrd",
    ),
    Leaf(
        "node keys", "host_keys:keys", "Write certificates for a run on several hosts.",
        "node keys secrets --hosts plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3",
    ),
)  # fmt: skip
OTHER = (
    Leaf(
        "export-plant", "export:export_plant",
        "Write the plant for other programs: an FMU or a C library.",
        "export-plant aluminium-3mm --out plant.fmu",
    ),
    Leaf(
        "bench", "bench:bench", "Measure how fast this computer runs a scene.",
        "bench aluminium-3mm --quick",
    ),
)  # fmt: skip
GROUPS: dict[str, tuple[str, tuple[Leaf, ...]]] = {
    "scene": ("Scenes: list, show, new, keys, check, modes.", SCENE),
    "law": ("Laws: list, new, replay, test.", LAW),
    "node": ("Run each process in its own terminal or on its own host.", NODE),
}
PANELS: dict[str, tuple[Leaf, ...] | dict[str, tuple[str, tuple[Leaf, ...]]]] = {
    "Main": MAIN,
    "Recordings": RECORDINGS,
    "Groups": GROUPS,
    "Other": OTHER,
}


def leaves() -> list[Leaf]:
    """Return all commands, in the order of the help."""
    return [*MAIN, *RECORDINGS, *SCENE, *LAW, *NODE, *OTHER]
