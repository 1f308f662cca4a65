"""The table of commands and their modules.

`rigctl --help` reads only this table, so that it responds at once; a command's module is imported when the
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
DATA = "Runs and data"
PHYSICS = "Physics"
TOOLS = "Tools"

ENTRIES = (
    Entry("demo", "rigctl.cli.demo:demo", START, "Run the main workflow on the simulated bench."),
    Entry("init", "rigctl.cli.init:init", START, "Create a working project folder."),
    Entry("check", "rigctl.cli.check:check", START, "Validate a file; print a procedure's plan."),
    Entry("simulate", "rigctl.cli.simulate:simulate", START, "Carry out a procedure on the simulated bench."),
    Entry("run", "rigctl.cli.run:run", BENCH, "Carry out a procedure on the bench."),
    Entry("resume", "rigctl.cli.resume:resume", BENCH, "Resume a run at its first incomplete record."),
    Entry("pause", "rigctl.cli.control:pause", BENCH, "Pause the run in progress, with outputs safe."),
    Entry("continue", "rigctl.cli.control:continue_", BENCH, "Continue a paused run."),
    Entry("abort", "rigctl.cli.control:abort", BENCH, "End the run in progress, outputs safe first."),
    Entry("off", "rigctl.cli.manual:off", BENCH, "Put all outputs into the safe state now."),
    Entry("jog", "rigctl.cli.manual:jog", BENCH, "Move one actuator by hand, within the limits."),
    Entry("monitor", "rigctl.cli.manual:monitor", BENCH, "Show the channels live, without a run."),
    Entry(
        "calibrate", "rigctl.cli.calibrate:calibrate", BENCH, "Calibrate a channel against reference values."
    ),
    Entry("runs", "rigctl.cli.runs:app", DATA, "List, show, verify, annotate, exclude and query runs."),
    Entry(
        "import", "rigctl.cli.import_:import_", DATA, "Import CSV, XLSX, Parquet, TDMS, MDF4 or MAT files."
    ),
    Entry("export", "rigctl.cli.export:export", DATA, "Export a run's data in these and other formats."),
    Entry(
        "report", "rigctl.cli.report:report", DATA, "Write one self-contained page about one or more runs."
    ),
    Entry(
        "serve", "rigctl.cli.serve:serve", DATA, "Show the project in a browser: runs, live, models, reports."
    ),
    Entry("oil", "rigctl.cli.oil:oil", PHYSICS, "Show density and viscosity over temperature and pressure."),
    Entry(
        "compare",
        "rigctl.cli.compare:compare",
        PHYSICS,
        "Compare models with data: agreement, and where it fails.",
    ),
    Entry(
        "diagnose", "rigctl.cli.diagnose:diagnose", PHYSICS, "Find the effect that a model lacks, and add it."
    ),
    Entry(
        "discover",
        "rigctl.cli.discover:discover",
        PHYSICS,
        "Find a formula for a term that the library lacks.",
    ),
    Entry(
        "design", "rigctl.cli.design:design", PHYSICS, "Design the next measurement to distinguish rivals."
    ),
    Entry("learn", "rigctl.cli.learn:learn", PHYSICS, "Measure, add significant effects, design, repeat."),
    Entry(
        "compensate",
        "rigctl.cli.compensate:compensate",
        PHYSICS,
        "Calculate and check a set-point schedule.",
    ),
    Entry("survey", "rigctl.cli.survey:survey", PHYSICS, "Find out what changed over many runs, and when."),
    Entry("model", "rigctl.cli.model:app", PHYSICS, "Show a model and its versions, and change it."),
    Entry(
        "family", "rigctl.cli.family_new:app", PHYSICS, "Draft a family, rig and model from your own data."
    ),
    Entry("effects", "rigctl.cli.effects:app", PHYSICS, "List, show and check effects, and your own."),
    Entry(
        "emulate",
        "rigctl.cli.emulate:emulate",
        TOOLS,
        "Emulate the board's firmware and its serial port.",
    ),
    Entry(
        "validate",
        "rigctl.cli.validate:validate",
        TOOLS,
        "Measure how often the diagnosis is right.",
    ),
    Entry("schema", "rigctl.cli.schema:schema", TOOLS, "Print the JSON Schema of a kind of file."),
    Entry("doctor", "rigctl.cli.doctor:doctor", TOOLS, "Report what is installed and what is missing."),
)

BY_NAME = {entry.name: entry for entry in ENTRIES}
