"""The table of all commands, by panel of the help."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CommandEntry:
    """A command of the command line.

    Attributes:
        words: Its words after `hertzloop`.
        function: The function that typer makes a command of, as "module:function".
        summary: The first sentence of its help.
        example: An example of its use, without `hertzloop`.
    """

    words: str
    function: str
    summary: str
    example: str

    @property
    def name(self) -> str:
        """The last word, which names the command within its group."""
        return self.words.split()[-1]


@dataclass(frozen=True)
class GroupEntry:
    """A word that several commands share, such as `scene` in `scene list`."""

    name: str
    summary: str
    commands: tuple[CommandEntry, ...]


MAIN = (
    CommandEntry(
        "run",
        "hertzloop.cli.run:run",
        "Run and record a scene, and compare it with the same run without control.",
        "run aluminium-3mm --set controller.latency_us=5",
    ),
    CommandEntry(
        "replay",
        "hertzloop.cli.recordings:replay",
        "Watch a recording in slow motion beside the run without control.",
        "replay aluminium-20mm.mcap --save replay.rrd",
    ),
    CommandEntry(
        "sweep",
        "hertzloop.cli.sweep:sweep",
        "Simulate a scene over ranges of its keys.",
        "sweep aluminium-3mm --over controller.latency_us=0:20:1 --over sensors.bits=8,12,16",
    ),
    CommandEntry(
        "tune",
        "hertzloop.cli.tune:tune",
        "Search for the law and the parameters with the best metrics in a scene.",
        "tune aluminium-20mm --law slope_threshold --law shifted_threshold --out-dir tuned",
    ),
    CommandEntry(
        "budget",
        "hertzloop.cli.budget:budget",
        "Find how much latency and how few bits a law tolerates.",
        "budget aluminium-3mm --law slope_threshold --goal 'plate_energy_db <= -3' --quick",
    ),
    CommandEntry(
        "margin",
        "hertzloop.cli.margin:margin",
        "Tell how stable a linear law's loop is in flight.",
        "margin aluminium-20mm --set controller.law=velocity_feedback --set controller.kappa=0.05",
    ),
    CommandEntry(
        "fit",
        "hertzloop.fitting.command:fit",
        "Fit keys of a scene to measured records.",
        "fit aluminium-3mm drop.csv --free sphere.radius_m --json fit.json",
    ),
    CommandEntry(
        "report",
        "hertzloop.cli.recordings:report",
        "Write an HTML report on a recording.",
        "report aluminium-20mm.mcap --out-dir pages",
    ),
)
RECORDINGS = (
    CommandEntry(
        "inspect",
        "hertzloop.cli.recordings:inspect",
        "Check a recording and print its metrics.",
        "inspect aluminium-20mm.mcap --json metrics.json",
    ),
    CommandEntry(
        "compare",
        "hertzloop.cli.recordings:compare",
        "Compare the bytes or the metrics of two recordings.",
        "compare a.mcap b.mcap --metrics",
    ),
    CommandEntry(
        "repair",
        "hertzloop.cli.recordings:repair",
        "Copy what is readable of a damaged recording into a complete file.",
        "repair broken.mcap --out whole.mcap",
    ),
    CommandEntry(
        "export",
        "hertzloop.cli.export:export",
        "Write a recording's samples as CSV, Parquet or MCAP.",
        "export aluminium-20mm.mcap --out samples.csv --from 0 --to 5",
    ),
    CommandEntry(
        "listen",
        "hertzloop.cli.listen:listen",
        "Write the sound of a run, with and without control, as WAV.",
        "listen aluminium-20mm.mcap --out-dir sounds --slow 10",
    ),
)
SCENE = (
    CommandEntry(
        "scene list",
        "hertzloop.cli.scene:list_scenes",
        "List the shipped scenes.",
        "scene list",
    ),
    CommandEntry(
        "scene show",
        "hertzloop.cli.scene:show",
        "Print a shipped scene as TOML.",
        "scene show aluminium-3mm",
    ),
    CommandEntry(
        "scene new",
        "hertzloop.cli.scene:new",
        "Write a commented scene that runs without changes.",
        "scene new mine.toml",
    ),
    CommandEntry(
        "scene keys",
        "hertzloop.cli.scene:keys",
        "List the keys of a scene: values, unit, default, meaning.",
        "scene keys latency",
    ),
    CommandEntry(
        "scene check",
        "hertzloop.cli.scene:check",
        "List the physical effects that a scene neglects, and the size of each.",
        "scene check aluminium-3mm",
    ),
    CommandEntry(
        "scene modes",
        "hertzloop.cli.scene:modes",
        "Write the modes of a scene's structure to a file.",
        "scene modes aluminium-3mm --out modes.csv",
    ),
)
LAW = (
    CommandEntry(
        "law list",
        "hertzloop.cli.law:list_laws",
        "List the shipped laws and their keys.",
        "law list",
    ),
    CommandEntry(
        "law new",
        "hertzloop.cli.law:new",
        "Write a commented law in Python or C that runs without changes.",
        "law new mine.py",
    ),
    CommandEntry(
        "law replay",
        "hertzloop.cli.law:replay",
        "Feed a recording's samples to another law and say where the forces differ.",
        "law replay aluminium-20mm.mcap --law shifted_threshold",
    ),
    CommandEntry(
        "law test",
        "hertzloop.cli.law:controller_test",
        "Test your own controller program in short runs.",
        "law test --controller 'python my_controller.py {name} {listen} {connect}'",
    ),
)
NODE = (
    CommandEntry(
        "node plant",
        "hertzloop.cli.node:plant",
        "Run the plant as a separate process.",
        "node plant aluminium-3mm --listen tcp/10.0.0.1:7450",
    ),
    CommandEntry(
        "node controller",
        "hertzloop.cli.node:controller",
        "Run the controller as a separate process.",
        "node controller --connect tcp/10.0.0.1:7450",
    ),
    CommandEntry(
        "node recorder",
        "hertzloop.cli.node:recorder",
        "Run the recorder as a separate process.",
        "node recorder --out run.mcap --connect tcp/10.0.0.1:7450",
    ),
    CommandEntry(
        "node watch",
        "hertzloop.cli.watch:watch",
        "Show a run in progress without delaying it.",
        "node watch --save live.rrd",
    ),
    CommandEntry(
        "node keys",
        "hertzloop.cli.host_keys:keys",
        "Write certificates for a run on several hosts.",
        "node keys secrets --hosts plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3",
    ),
)
OTHER = (
    CommandEntry(
        "export-plant",
        "hertzloop.cli.export:export_plant",
        "Write the plant for other programs: an FMU or a C library.",
        "export-plant aluminium-3mm --out plant.fmu",
    ),
)
GROUPS = (
    GroupEntry("scene", "Scenes: list, show, new, keys, check, modes.", SCENE),
    GroupEntry("law", "Laws: list, new, replay, test.", LAW),
    GroupEntry("node", "Run each process in its own terminal or on its own host.", NODE),
)
PANELS: dict[str, tuple[CommandEntry | GroupEntry, ...]] = {
    "Main": MAIN,
    "Recordings": RECORDINGS,
    "Groups": GROUPS,
    "Other": OTHER,
}


def all_commands() -> list[CommandEntry]:
    """Return all commands, in the order of the help."""
    return [*MAIN, *RECORDINGS, *SCENE, *LAW, *NODE, *OTHER]
