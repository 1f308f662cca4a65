"""Which commands there are and where each lives.

`rigctl --help` reads only this table, so that it answers at once; a command's module is imported when the
command is called.
"""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """One command: its name, the object that implements it, and the line shown in the overview."""

    name: str
    target: str
    panel: str
    summary: str


START = "Start here"
BENCH = "At the bench"
DATA = "What was measured"
PHYSICS = "Physics"
TOOLS = "Tools"

ENTRIES = (
    Entry("demo", "rigctl.cli.demo:demo", START, "The main job on the simulated bench, ending in a page."),
    Entry("init", "rigctl.cli.init:init", START, "Make a working project folder."),
    Entry("check", "rigctl.cli.check:check", START, "Validate a file; print a procedure's plan."),
    Entry("simulate", "rigctl.cli.simulate:simulate", START, "Carry out a procedure on the simulated bench."),
    Entry("run", "rigctl.cli.run:run", BENCH, "Carry out a procedure on the bench."),
    Entry("resume", "rigctl.cli.resume:resume", BENCH, "Go on with a run at its first incomplete record."),
    Entry("pause", "rigctl.cli.control:pause", BENCH, "Pause a run in progress, outputs safe."),
    Entry("continue", "rigctl.cli.control:continue_", BENCH, "Let a paused run go on."),
    Entry("abort", "rigctl.cli.control:abort", BENCH, "End a run in progress, outputs safe first."),
    Entry("off", "rigctl.cli.manual:off", BENCH, "Put everything into the safe state now."),
    Entry("jog", "rigctl.cli.manual:jog", BENCH, "Move one actuator by hand, within the limits."),
    Entry("monitor", "rigctl.cli.manual:monitor", BENCH, "Watch the channels without a run."),
    Entry(
        "calibrate", "rigctl.cli.calibrate:calibrate", BENCH, "Calibrate a channel against reference values."
    ),
    Entry("runs", "rigctl.cli.runs:app", DATA, "List, show, verify, annotate, exclude and query runs."),
    Entry("import", "rigctl.cli.import_:import_", DATA, "Bring in CSV, XLSX, Parquet, TDMS, MDF4 or MAT."),
    Entry("export", "rigctl.cli.export:export", DATA, "Hand out a run's data in these formats."),
    Entry("report", "rigctl.cli.report:report", DATA, "One self-contained page about one or more runs."),
    Entry("serve", "rigctl.cli.serve:serve", DATA, "The project in a browser: runs, live, models, reports."),
    Entry("oil", "rigctl.cli.oil:oil", PHYSICS, "Density and viscosity over temperature and pressure."),
    Entry("compare", "rigctl.cli.compare:compare", PHYSICS, "How well a model agrees, and where it fails."),
    Entry("diagnose", "rigctl.cli.diagnose:diagnose", PHYSICS, "Which effect a model lacks, and adding it."),
    Entry(
        "discover", "rigctl.cli.discover:discover", PHYSICS, "A formula for what no effect of the library is."
    ),
    Entry("design", "rigctl.cli.design:design", PHYSICS, "What to measure next, to tell apart what is left."),
    Entry("learn", "rigctl.cli.learn:learn", PHYSICS, "Measure, add what is sure, design, measure again."),
    Entry(
        "compensate",
        "rigctl.cli.compensate:compensate",
        PHYSICS,
        "A set-point schedule that keeps a quantity, and its check.",
    ),
    Entry("survey", "rigctl.cli.survey:survey", PHYSICS, "Many runs, one model: what changed, since when."),
    Entry("model", "rigctl.cli.model:app", PHYSICS, "What a model says, its versions, and how to change it."),
    Entry(
        "family", "rigctl.cli.family_new:app", PHYSICS, "A first family, rig and model from your own data."
    ),
    Entry("effects", "rigctl.cli.effects:app", PHYSICS, "The library of effects, and your own."),
    Entry(
        "emulate",
        "rigctl.cli.emulate:emulate",
        TOOLS,
        "The board's firmware emulated, its port for any client.",
    ),
    Entry(
        "validate",
        "rigctl.cli.validate:validate",
        TOOLS,
        "How often the diagnosis is right, on a bench that hides effects.",
    ),
    Entry("schema", "rigctl.cli.schema:schema", TOOLS, "JSON Schema of the files a user writes."),
    Entry("doctor", "rigctl.cli.doctor:doctor", TOOLS, "What is installed, what is missing, how to get it."),
)

BY_NAME = {entry.name: entry for entry in ENTRIES}
