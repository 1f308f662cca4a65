"""`rigctl learn`: measure, compare, add what is significant, design the next records, and measure again.

In: a procedure and a model, or a learning that was interrupted. Out: runs, versions of the model, and a
page about the rounds. The loop is `rigctl.learning.learn.Learner`; this module gives it a bench, a person
who is asked, and a folder.

The options of the first call are kept in that folder as a `Task`, since `--resume` after a kill or a
power cut must measure on the same bench in the same way; only time, rounds and precision are taken anew.
Errors in what was typed are found before the folder is made. On a simulated bench each round has the next
seed: two records with the same noise would count as one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.analysis import HoldOut
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.cache import Evidence
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.cli.options.family import FamilyOption
from rigctl.cli.options.identity import NotesOption, PartOption, SerialNumberOption
from rigctl.cli.options.port import PortOption
from rigctl.cli.options.procedure import ArgumentOption, RigOption
from rigctl.cli.options.serve import ServeOption
from rigctl.cli.question import confirm
from rigctl.errors import ExitCode, RigctlError

if TYPE_CHECKING:
    from rigctl.design.result import DesignResult
    from rigctl.learning.bench import LaunchedBench
    from rigctl.learning.learning_folder import LearningFolder, Task
    from rigctl.learning.result import Learned, Round
    from rigctl.plan import Plan
    from rigctl.runner.launch import Launch

#: default number of rounds, including the first
_ROUNDS = 5


def learn(
    procedure: Annotated[
        Path | None,
        typer.Argument(help="Procedure of the first round; not with --resume.", show_default=False),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", "-m", help="Model file, to which significant effects are added.", show_default=False
        ),
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Limit on bench time for all rounds, including heating and settling: 30m, 2h.",
            show_default=False,
        ),
    ] = None,
    rounds: Annotated[
        int | None,
        typer.Option(
            "--max-rounds",
            metavar="N",
            min=1,
            help="Maximum number of rounds, including the first; by default 5.",
        ),
    ] = None,
    precision: Annotated[
        str | None,
        typer.Option(
            metavar="SHARE",
            help="Continue until the size of every added effect is known to within this relative "
            "half width of its 95 % interval: 10 %.",
            show_default=False,
        ),
    ] = None,
    run: Annotated[
        list[str] | None,
        typer.Option("--from", metavar="RUN", help="Run to start with instead of the procedure; repeatable."),
    ] = None,
    hold_out: HoldOut = None,
    backend: Annotated[
        str | None, typer.Option(help="Backend, as for 'rigctl run'; by default that of the rig file.")
    ] = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    rig: RigOption = None,
    arg: ArgumentOption = None,
    operator: Annotated[str | None, typer.Option(help="Person in charge; kept with each run.")] = None,
    serial_number: SerialNumberOption = None,
    part: PartOption = None,
    notes: NotesOption = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed for the simulated bench; each round uses the next."),
    ] = None,
    speed: Annotated[
        str | None, typer.Option(help="max on a simulated bench, else 1x.", show_default=False)
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--with", metavar="EFFECT[:P=V,...]", help="Hidden effect of a simulated bench; repeatable."
        ),
    ] = None,
    family: FamilyOption = None,
    *,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Carry out every round without asking.")] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Resume the last session; more time or rounds can be given.")
    ] = False,
    serve: ServeOption = False,
    verbose: Evidence = False,
    as_json: Json = False,
) -> None:
    """Measure in rounds until the model agrees with the data and every effect in it is distinguished from
    its rivals.

    Each round is a run like any other, with its interlocks. The model is then compared with all data
    measured so far, any effect that is significant is added as its next version, and where the data cannot
    distinguish effects, records that would are designed. You are asked before each round is run; its
    predicted power is compared with the result. It ends when no question remains, when no record on this
    bench could answer it, or when the time or the rounds are used up.

    Ctrl-C ends a run safely; '--resume' continues from there, also after a kill or a power cut.

    Examples:

      rigctl learn procedures/campaign.yaml --model models/hl32-textbook.yaml --budget 2h

      rigctl learn --resume --yes
    """
    from rigctl.answers.learning import learned_blocks, round_blocks
    from rigctl.cli.blocks import show
    from rigctl.cli.commands.design import read_budget
    from rigctl.cli.options.serve import shown
    from rigctl.cli.progress import progress_display
    from rigctl.learning.learn import Learner
    from rigctl.project import find_project

    time = None if budget is None else read_budget(budget)
    wanted = None if precision is None else read_share(precision)
    # The session first: what is asked, on which bench, and how much time is left, from its folder or from
    # the options.
    if resume:
        of_session = {
            "procedure": procedure,
            "--model": model,
            "--rig": rig,
            "--arg": arg,
            "--from": run,
            "--hold-out": hold_out,
            "--backend": backend,
            "--port": port,
            "--with": effect,
            "--seed": seed,
            "--speed": speed,
            "--serial-number": serial_number,
            "--part": part,
            "--notes": notes,
        }
        session = _resumed(
            [name for name, value in of_session.items() if value not in (None, [])], time, rounds, wanted
        )
    else:
        labels = {"serial_number": serial_number, "part": part, "notes": notes}
        bench = {
            "backend": backend,
            "port": port,
            "seed": seed,
            "speed": speed,
            "effects": effect,
            "device": {name: text for name, text in labels.items() if text},
        }
        given = {name: value for name, value in bench.items() if value not in (None, "", [], (), {})}
        task_arguments = (given, time, rounds, hold_out or "", wanted)
        session = _new_session(procedure, model, rig, arg or [], run or [], *task_arguments)
    person = _person(operator)

    # Then the loop, which knows neither terminal nor page: it calls `ask` before each round after the
    # first, and `on_round` after each.
    def ask(proposal: Round, design: DesignResult) -> bool:
        _show_proposal(proposal, design, quiet=as_json, verbose=verbose)
        return yes or _confirmed()

    with shown(wanted=serve):
        learner = Learner(
            session,
            _bench(session.task, person),
            find_project().runs,
            ask,
            working=lambda: progress_display(
                "Reading the records",
                "measurements and additions are kept; 'rigctl learn --resume' continues",
            ),
            on_round=lambda one: None if as_json else show(round_blocks(one)),
        )
        try:
            learned = learner.learn()
        # A first call that fails before anything was measured leaves no folder behind, so that '--resume'
        # finds the session before it.
        except RigctlError:
            if not resume:
                session.discard_if_nothing_was_learned(find_project().runs)
            raise
        # For every ending: being out of time or declined is a result too.
        page = _write_page(session, learned)
        if as_json:
            print_json(learned.document() | {"folder": session.folder.as_posix(), "page": page.as_posix()})
        else:
            show(learned_blocks(learned, session.folder, page))
    raise typer.Exit(int(learned.exit_code))


def _show_proposal(one: Round, design: DesignResult, *, quiet: bool, verbose: bool) -> None:
    """Show the proposed records; with `verbose` also the predictions for each pair."""
    from rigctl.answers.design.design import design_answer, whole_design
    from rigctl.cli.blocks import show, show_answer

    echo(f"\nRound {one.number} would be {one.procedure}", err=True)
    if quiet:
        echo(design.statement, err=True)
    elif verbose:
        show(whole_design(design))
    else:
        show_answer(design_answer(design))


def read_share(text: str) -> float:
    """A share between none and all: ``10 %`` or ``0.1``.

    Raises
    ------
    RigctlError
        it is none.
    """
    from rigctl.units import read_si

    try:
        share = read_si(text, "1")
    except RigctlError:
        share = 0.0
    if not 0.0 < share < 1.0:
        raise RigctlError("--precision: not a percentage", value=text, expected="e.g. 10 %")
    return share


def _resumed(
    given: Sequence[str], time: float | None, rounds: int | None, precision: float | None
) -> LearningFolder:
    """The last session; `given` are options that only its beginning takes."""
    from rigctl.learning.learning_folder import LearningFolder
    from rigctl.project import find_project

    if given:
        raise RigctlError(
            "--resume: procedure, model, bench and records are those of the session",
            value=", ".join(given),
            expected="at most --budget, --max-rounds and --precision, which may change",
        )
    session = LearningFolder.find(find_project().root)
    session.reopen(budget=time, rounds=rounds, precision=precision)
    return session


def _new_session(
    procedure: Path | None,
    model: Path | None,
    rig: Path | None,
    arguments: list[str],
    runs: list[str],
    bench: Mapping[str, Any],
    time: float | None,
    rounds: int | None,
    hold_out: str,
    precision: float | None,
) -> LearningFolder:
    """Start a new learning; all errors are found before a folder is made."""
    from rigctl.cli.plans import open_plan, read_assignments
    from rigctl.dataset import find_run
    from rigctl.learning.learn import require_time
    from rigctl.learning.learning_folder import LearningFolder, Task
    from rigctl.model import current_version
    from rigctl.project import find_file, find_project, own_model

    # In the order of what is needed for it: the model, the plan for its bench, the bench itself, and the
    # time of the first round. The folder comes last.
    if procedure is None or model is None:
        missing = "a procedure" if procedure is None else "--model"
        raise RigctlError(
            f"{missing} is missing", expected="rigctl learn PROCEDURE --model M, or rigctl learn --resume"
        )
    path = own_model(model)
    plan = open_plan(procedure, rig, arguments)
    _require_bench(plan, bench)
    if not runs:
        require_time(plan, time)
    task = Task(
        procedure=str(find_file(procedure).absolute()),
        model=str(path.absolute()),
        version=current_version(path).number,
        rig="" if rig is None else str(find_file(rig).absolute()),
        arguments=read_assignments(arguments),
        bench=dict(bench),
        runs=tuple(find_run(name).name for name in runs),
        budget=time,
        rounds=rounds or _ROUNDS,
        hold_out=hold_out,
        precision=precision,
    )
    return LearningFolder.create(find_project().root, task, plan.name)


def _bench(task: Task, person: str) -> LaunchedBench:
    from rigctl.cli.attended_run import attended
    from rigctl.learning.bench import LaunchedBench

    def present(how: Launch, plan: Plan) -> AbstractContextManager[Launch]:
        return attended(how, plan, {})

    return LaunchedBench(
        how=lambda plan, number: _launch(plan, number, task.bench, person),
        rig=Path(task.rig) if task.rig else None,
        attended=present,
    )


def _require_bench(plan: Plan, bench: Mapping[str, Any]) -> None:
    """Refuse wrong settings of the bench, including hidden effects, before anything is made."""
    from rigctl.backends.registry import create_backend
    from rigctl.runner.bench_access import UNREAL

    how = _launch(plan, 1, bench, "")
    if how.backend in UNREAL:
        create_backend(plan.rig, how.backend, how.clock, how.options)


def _launch(plan: Plan, number: int, bench: Mapping[str, Any], person: str) -> Launch:
    """The access of round `number` to its bench."""
    from rigctl.project import find_project
    from rigctl.runner.bench_access import bench_options, clock_for
    from rigctl.runner.launch import Launch
    from rigctl.runner.operators.automatic_operator import AutomaticOperator
    from rigctl.runner.simulation import simulation_launch

    # Each round has the seed after that of the one before, on whichever bench has one: the same noise twice
    # would count as a single record.
    kind = bench.get("backend") or plan.rig.backend_named()
    runs = find_project().runs
    first = plan.rig.simulation.seed if bench.get("seed") is None else int(bench["seed"])
    if kind == "simulated":
        return simulation_launch(
            plan,
            runs,
            effects=tuple(bench.get("effects") or ()),
            seed=first + number - 1,
            speed=bench.get("speed") or "max",
            arguments=plan.arguments,
            person=person,
            device=bench.get("device"),
        )
    # Any other bench, real ones among them, is accessed as by `rigctl run`.
    if bench.get("effects"):
        raise RigctlError("--with: only a simulated bench hides effects", value=kind)
    seed = first + number - 1 if kind == "emulated" else bench.get("seed")
    return Launch(
        runs=runs,
        operator=AutomaticOperator(),
        backend=kind,
        options=bench_options(kind, plan.rig, port=bench.get("port"), seed=seed, runs=runs),
        clock=clock_for(bench.get("speed") or "1x", kind),
        person=person,
        device=bench.get("device") or {},
        arguments=plan.arguments,
        seed=seed,
    )


def _person(given: str | None) -> str:
    from rigctl.cli.attended_run import person_in_charge

    return person_in_charge(given)


def _confirmed() -> bool:
    """Whether the person at the terminal agrees; False if there is none."""
    from rigctl.cli.attended_run import typing_possible

    if not typing_possible():
        return False
    try:
        return confirm("Carry it out?")
    except typer.Abort:
        raise RigctlError(
            "Stopped; 'rigctl learn --resume' asks again", exit_code=ExitCode.INTERRUPTED
        ) from None


def _write_page(session: LearningFolder, learned: Learned) -> Path:
    """Write the page into the learning's folder; replaced after every session."""
    from rigctl.cli.analysis_page import named_versions
    from rigctl.dataset import find_run, open_run
    from rigctl.project import find_project
    from rigctl.report import write_report
    from rigctl.report.analysis import learning_sections

    page = session.folder / "learning.html"
    runs = [open_run(find_run(name, find_project().runs)) for name in session.runs]
    if runs:
        # The figure of the versions needs a fit of each, which is worth it only if a round has been
        # evaluated.
        task, versions = session.task, None
        if any(one.judged for one in learned.rounds):
            versions = named_versions(runs, Path(task.model), task.version, hold_out=task.hold_out or None)
        write_report(runs, page, sections=learning_sections(learned, Path(task.model), versions), force=True)
    return page
