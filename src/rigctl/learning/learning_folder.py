"""State of a learning loop on disk, from which it resumes after any interruption: its task and each round.

In: a task, and each change of a round as it happens. Out: one JSON file, replaced atomically, beside the
procedures that were designed. A bench may be cut off at any time, and a measured record costs more than any
computation: what was measured or answered is never done again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.dataset import list_runs
from rigctl.dataset.run_id import new_run_id, next_free
from rigctl.errors import RigctlError, nearest_name
from rigctl.files.regular import read_text
from rigctl.files.write import write_json, write_new
from rigctl.json_values import parse_json
from rigctl.learning.ending import LearningEnd
from rigctl.learning.result import Learned, Round
from rigctl.model import current_version

_STATE = "learning.json"
_VERSION = 1
#: length of the time stamp at the start of the id of a run or a session
STAMP = 15
#: endings after which another answer, more time or more rounds allow it to continue
_GOES_ON = (LearningEnd.DECLINED, LearningEnd.BUDGET, LearningEnd.ROUNDS, LearningEnd.STOPPED)


@dataclass(frozen=True)
class Task:
    """The task as given.

    Attributes
    ----------
    procedure: of the first round; `arguments` of it.
    model: the file whose next versions are saved; it was at `version` when learning started.
    rig: a rig file to use instead of the one that the procedure names; "" for that one.
    bench: how the bench is reached: backend, port, seed, hidden effects, as given.
    runs: existing data; the first round is not carried out then.
    budget: of bench time, s, None for unlimited; `rounds` the largest number of rounds.
    precision: largest 95 % half-width of an added effect's size, as a share of it, that is accepted; None for
        any.
    """

    procedure: str
    model: str
    version: int
    rig: str = ""
    arguments: Mapping[str, str] = field(default_factory=dict)
    bench: Mapping[str, Any] = field(default_factory=dict)
    runs: tuple[str, ...] = ()
    budget: float | None = None
    rounds: int = 5
    hold_out: str = ""
    precision: float | None = None

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            **vars(self),
            "arguments": dict(self.arguments),
            "bench": dict(self.bench),
            "runs": list(self.runs),
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Task:
        """The task that `document` made."""
        return cls(**{**document, "runs": tuple(document["runs"])})


@dataclass
class LearningFolder:
    """A folder with the task, its rounds so far and the procedures that were designed.

    Attributes
    ----------
    folder: ``learning/<date>-<procedure>`` of the project.
    rounds: their current state; each change is on disk before anything else happens.
    """

    folder: Path
    task: Task
    rounds: list[Round] = field(default_factory=list)
    learned: Mapping[str, Any] | None = None

    @classmethod
    def create(cls, project: Path, task: Task, name: str) -> LearningFolder:
        """A new folder for a task; no existing folder is changed.

        Raises
        ------
        RigctlError
            the folder cannot be made.
        """
        parent = project / "learning"
        folder = parent / new_run_id(name, datetime.now(UTC), parent)
        try:
            folder.mkdir(parents=True)
        except OSError as problem:
            raise RigctlError(
                "the folder cannot be made", value=folder.as_posix(), hint=str(problem)
            ) from problem
        record = cls(folder, task)
        record.write()
        return record

    @classmethod
    def find(cls, project: Path, wanted: str = "") -> LearningFolder:
        """The folder with this name, or the latest one.

        Raises
        ------
        RigctlError
            there is none, or its file cannot be read.
        """
        folders = sorted(one.parent for one in (project / "learning").glob(f"*/{_STATE}"))
        if wanted:
            exact = [one for one in folders if one.name == wanted]
            chosen = exact or [one for one in folders if one.name.startswith(wanted)]
            if len(chosen) != 1:
                names = [one.name for one in folders]
                raise RigctlError(
                    "no such learning session" if not chosen else "several sessions start like this",
                    value=wanted,
                    nearest=nearest_name(wanted, names),
                )
            return cls._read(chosen[0])
        if folders:
            return cls._read(folders[-1])
        raise RigctlError(
            "there is nothing to continue",
            hint="'rigctl learn PROCEDURE --model M' starts learning",
            value=project.as_posix(),
        )

    @classmethod
    def _read(cls, folder: Path) -> LearningFolder:
        path = folder / _STATE
        try:
            document = parse_json(read_text(path))
            if document["version"] != _VERSION:
                raise ValueError(f"version {document['version']}")
            rounds = [Round.read(one) for one in document["rounds"]]
            return cls(folder, Task.read(document["task"]), rounds, document["learned"])
        except (OSError, ValueError, KeyError, TypeError) as problem:
            raise RigctlError(
                "the learning session cannot be read", value=path.as_posix(), hint=str(problem)
            ) from problem

    def write(self) -> None:
        """Put all of it on disk atomically."""
        write_json(
            self.folder / _STATE,
            {
                "version": _VERSION,
                "task": self.task.document(),
                "rounds": [one.document() for one in self.rounds],
                "learned": self.learned,
            },
        )

    def begin(self, one: Round, text: str = "") -> Round:
        """Add a round; `text` is the procedure designed for it, kept in the folder."""
        if text:
            path = self.folder / f"{next_free(f'round-{one.number}', self.folder, '.yaml')}.yaml"
            write_new(path, text.encode("utf-8"))
            one = replace(one, procedure=path.as_posix())
        self.rounds.append(one)
        self.write()
        return one

    def update(self, one: Round) -> Round:
        """Put the current state of the last round on disk."""
        self.rounds[-1] = one
        self.write()
        return one

    def discard_if_nothing_was_learned(self, runs: Path) -> None:
        """Remove the folder of a session that was refused before anything happened: it holds only the task.

        Whatever prevents that is not reported: the refusal that led here is what the user has to see.

        Parameters
        ----------
        runs: where the bench's runs are; one of this session may have begun, and can be resumed only from it.
        """
        with suppress(OSError, RigctlError):
            if self._holds_only_the_task() and not self._has_changed_anything(runs):
                (self.folder / _STATE).unlink()
                self.folder.rmdir()
                if not any(self.folder.parent.iterdir()):  # the project's first session
                    self.folder.parent.rmdir()

    def _holds_only_the_task(self) -> bool:
        results = any(one.run or one.lost or one.verdict for one in self.rounds)
        return not results and [one.name for one in self.folder.iterdir()] == [_STATE]

    def _has_changed_anything(self, runs: Path) -> bool:
        """Whether the model has another version since, or a run has begun since, perhaps somebody else's."""
        since = self.folder.name[:STAMP]
        return current_version(Path(self.task.model)).number != self.task.version or any(
            summary.id[:STAMP] >= since for summary in list_runs(runs)
        )

    def close(self, learned: Learned) -> Learned:
        """Record that it has ended, unless it can continue."""
        if learned.ended is not LearningEnd.STOPPED:
            self.learned = learned.document()
            self.write()
        return learned

    def reopen(
        self, *, budget: float | None = None, rounds: int | None = None, precision: float | None = None
    ) -> None:
        """Continue after an interruption, a declined proposal, or the end of time or rounds; or with an
        adequate model, to estimate its sizes better.

        Parameters
        ----------
        budget, rounds, precision: replace those of the task.

        Raises
        ------
        RigctlError
            it ended in a way that more rounds do not change.
        """
        ended = None if self.learned is None else LearningEnd(self.learned["ended"])
        sharper = ended is LearningEnd.ADEQUATE and precision is not None
        if ended is not None and ended not in _GOES_ON and not sharper:
            raise RigctlError(
                f"this learning session has ended: {ended.value.replace('_', ' ')}",
                value=self.folder.name,
                hint=str(self.learned and self.learned["statement"]),
            )
        self.learned = None
        self.task = replace(
            self.task,
            budget=self.task.budget if budget is None else budget,
            rounds=self.task.rounds if rounds is None else rounds,
            precision=self.task.precision if precision is None else precision,
        )
        self.write()

    @property
    def runs(self) -> Sequence[str]:
        """Every run so far, starting with those that existed before."""
        return [*self.task.runs, *(one.run for one in self.rounds if one.run)]

    @property
    def spent(self) -> float:
        """Bench time so far, s; that of runs that failed is spent too."""
        return sum(one.duration + one.lost for one in self.rounds)
