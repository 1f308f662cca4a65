"""The table of commands and their modules.

`rigctl --help` reads only this table, so that it responds at once; a command's module is imported when the
command is called.
"""

from __future__ import annotations

from typing import NamedTuple


class Entry(NamedTuple):
    """One command: its name, what implements it, and its line in the overview.

    The module of `target` is in `rigctl.cli.commands`, or in `package` if that is another distribution's.
    """

    name: str
    target: str
    panel: str
    summary: str
    package: str = "rigctl.cli.commands"


START = "Start here"
BENCH = "At the bench"
DATA = "Runs and data"
PHYSICS = "Physics"
TOOLS = "Tools"

ENTRIES = (
    Entry("demo", "demo:demo", START, "Run the main workflow on the simulated bench."),
    Entry("init", "init:init", START, "Create a working project folder."),
    Entry("check", "check.check:check", START, "Validate a file; print a procedure's plan."),
    Entry("simulate", "simulate:simulate", START, "Carry out a procedure on the simulated bench."),
    Entry("run", "run:run", BENCH, "Carry out a procedure on the bench."),
    Entry("resume", "resume:resume", BENCH, "Resume a run at its first incomplete record."),
    Entry("pause", "control:pause", BENCH, "Pause the run in progress, with outputs safe."),
    Entry("continue", "control:continue_", BENCH, "Continue a paused run."),
    Entry("abort", "control:abort", BENCH, "End the run in progress, outputs safe first."),
    Entry("off", "manual:off", BENCH, "Put all outputs into the safe state now."),
    Entry("jog", "manual:jog", BENCH, "Move one actuator by hand, within the limits."),
    Entry("monitor", "manual:monitor", BENCH, "Show the channels live, without a run."),
    Entry("calibrate", "calibrate:calibrate", BENCH, "Calibrate a channel against reference values."),
    Entry("runs", "runs:app", DATA, "List, show, verify, annotate, exclude and query runs."),
    Entry("import", "import_:import_", DATA, "Import CSV, XLSX, Parquet, TDMS, MDF4 or MAT files."),
    Entry("export", "export:export", DATA, "Export a run's data in these and other formats."),
    Entry("report", "report:report", DATA, "Write one self-contained page about one or more runs."),
    Entry("serve", "serve:serve", DATA, "Show the project in a browser: runs, live, models, reports."),
    Entry("oil", "oil:oil", PHYSICS, "Show density and viscosity over temperature and pressure."),
    Entry("compare", "compare:compare", PHYSICS, "Compare models with data: agreement, and where it fails."),
    Entry(
        "frequency", "frequency:frequency", PHYSICS, "Measure a frequency response, and compare a model's."
    ),
    Entry("diagnose", "diagnose:diagnose", PHYSICS, "Find the effect that a model lacks, and add it."),
    Entry("discover", "discover:discover", PHYSICS, "Find a formula for a term that the library lacks."),
    Entry("design", "design:design", PHYSICS, "Design the next measurement to distinguish rivals."),
    Entry("learn", "learn:learn", PHYSICS, "Measure, add significant effects, design, repeat."),
    Entry("compensate", "compensate:compensate", PHYSICS, "Calculate and check a set-point schedule."),
    Entry("survey", "survey:survey", PHYSICS, "Find out what changed over many runs, and when."),
    Entry("model", "model.model:app", PHYSICS, "Show a model and its versions, and change it."),
    Entry("family", "family.new:app", PHYSICS, "Draft a family, rig and model from your own data."),
    Entry("effects", "effects:app", PHYSICS, "List, show and check effects, and your own."),
    Entry("emulate", "emulate:emulate", TOOLS, "Emulate the board's firmware and its serial port."),
    Entry(
        "validate",
        "command:validate",
        TOOLS,
        "Measure how often diagnoses are right (package rigctl-validation).",
        "rigctl_validation",
    ),
    Entry("schema", "schema:schema", TOOLS, "Print the JSON Schema of a kind of file."),
    Entry("doctor", "doctor.doctor:doctor", TOOLS, "Report what is installed and what is missing."),
)

BY_NAME = {entry.name: entry for entry in ENTRIES}
