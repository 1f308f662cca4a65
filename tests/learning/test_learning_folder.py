"""The stored state of learning: read back, resumed where that makes sense, otherwise refused."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.errors import RigctlError
from rigctl.learning.ending import LearningEnd
from rigctl.learning.learning_folder import STAMP, LearningFolder, Task
from rigctl.learning.result import Learned, PredictedRound, Round, RoundOutcome

NAMES = st.sampled_from(["leak", "drift", "coulomb_friction", "none"])
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)
TEXTS = st.text(max_size=20)

PREDICTIONS = st.builds(
    PredictedRound,
    rivals=st.dictionaries(NAMES, st.floats(0, 1), max_size=3),
    separation=NUMBERS,
    probability=st.floats(0, 1),
    outlooks=st.lists(
        st.fixed_dictionaries({"truth": NAMES, "rival": NAMES, "margin": NUMBERS}), max_size=2
    ).map(tuple),
    duration=NUMBERS,
    records=st.lists(TEXTS, max_size=2).map(tuple),
    aim=st.sampled_from(["discrimination", "precision"]),
    sharpened=st.lists(
        st.fixed_dictionaries({"parameter": NAMES, "unit": TEXTS, "before": NUMBERS, "after": NUMBERS}),
        max_size=2,
    ).map(tuple),
)
OUTCOMES = st.builds(
    RoundOutcome,
    winner=NAMES,
    gains=st.dictionaries(NAMES, NUMBERS, max_size=2),
    expected=st.fixed_dictionaries(dict.fromkeys(["leak", "drift", "coulomb_friction", "none"], NUMBERS)),
    distinguished=st.booleans(),
    kept=st.booleans(),
    sizes=st.dictionaries(NAMES, NUMBERS, max_size=2),
)
ROUNDS = st.builds(
    Round,
    number=st.integers(1, 9),
    procedure=TEXTS,
    run=TEXTS,
    duration=NUMBERS,
    verdict=st.sampled_from(["", "adequate", "ambiguous"]),
    effects=st.lists(NAMES, max_size=2).map(tuple),
    classes=st.lists(st.lists(NAMES, max_size=2).map(tuple), max_size=2).map(tuple),
    probabilities=st.dictionaries(NAMES, st.floats(0, 1), max_size=3),
    added=st.lists(st.tuples(NAMES, st.integers(1, 9)), max_size=2).map(tuple),
    error=st.dictionaries(NAMES, NUMBERS, max_size=2),
    chi2=st.none() | NUMBERS,
    statement=TEXTS,
    predicted=st.none() | PREDICTIONS,
    achieved=st.none() | OUTCOMES,
    answer=st.sampled_from(["", "yes", "no"]),
)
TASK = Task("campaign.yaml", "m.yaml", 1, arguments={"supply": "30 bar"}, bench={"seed": 3}, rounds=4)


@given(ROUNDS)
def test_a_round_survives_json(one: Round) -> None:
    again = Round.read(one.document())
    assert again == one
    assert again.document() == one.document()


def test_the_state_of_an_earlier_version_is_read() -> None:
    """Its predictions have no aim, its outcomes no sizes, its task no precision; its sentence is kept."""
    predicted = PredictedRound({"leak": 1.0}, 12.0, 0.9, (), 600.0, ("oil 60 degC",))
    out = RoundOutcome("leak", {}, {}, distinguished=True, kept=True, recorded="leak is told apart")
    document = Round(2, "round-2.yaml", predicted=predicted, achieved=out).document()
    for part, names in (("promised", ("aim", "sharpened")), ("came_out", ("sizes",))):
        for name in names:
            del document[part][name]
    del document["lost"]
    read = Round.read(document)
    assert read == Round(2, "round-2.yaml", predicted=predicted, achieved=out)
    assert read.outcome == document["came_out"]["statement"] == "leak is told apart"
    task = TASK.document()
    del task["precision"]
    assert Task.read(task) == TASK


def test_adequate_learning_can_be_resumed_for_a_higher_precision(tmp_path: Path) -> None:
    kept = LearningFolder.create(tmp_path, TASK, "stroke")
    kept.close(Learned((), LearningEnd.ADEQUATE, "m.yaml", 1, 0.0, RigctlError("why")))
    LearningFolder.find(tmp_path).reopen(precision=0.1)
    assert LearningFolder.find(tmp_path).task.precision == 0.1


def test_the_stored_state_is_found_again(tmp_path: Path) -> None:
    kept = LearningFolder.create(tmp_path, TASK, "Stroke campaign")
    kept.begin(Round(1, "campaign.yaml", answer="yes"))
    proposal = kept.begin(Round(2, ""), "procedure: next\n")
    assert Path(proposal.procedure).read_text() == "procedure: next\n"
    again = LearningFolder.find(tmp_path)
    assert again.task == TASK
    assert again.rounds == kept.rounds
    assert again.folder == kept.folder


def test_two_sessions_begun_in_the_same_second_have_separate_folders(tmp_path: Path) -> None:
    first, second = (LearningFolder.create(tmp_path, TASK, "stroke") for _ in range(2))
    assert first.folder != second.folder


def test_a_full_name_finds_its_folder_although_another_name_starts_with_it(tmp_path: Path) -> None:
    first, second = (LearningFolder.create(tmp_path, TASK, name) for name in ("stroke", "other"))
    longer = second.folder.rename(first.folder.with_name(f"{first.folder.name}-2"))
    for folder in (first.folder, longer):
        assert LearningFolder.find(tmp_path, folder.name).folder == folder
    with pytest.raises(RigctlError, match="several sessions start like this"):
        LearningFolder.find(tmp_path, first.folder.name[:-1])


def test_a_session_is_discarded_only_if_nothing_has_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With `--run` the model had a new version by then, or a run had begun that only the session resumes."""
    version, runs = TASK.version, ["20200101-000000-earlier"]
    monkeypatch.setattr(
        "rigctl.learning.learning_folder.current_version", lambda _: SimpleNamespace(number=version)
    )
    monkeypatch.setattr(
        "rigctl.learning.learning_folder.list_runs", lambda _: [SimpleNamespace(id=one) for one in runs]
    )
    kept = LearningFolder.create(tmp_path, TASK, "stroke")
    version += 1
    kept.discard_if_nothing_was_learned(tmp_path)
    version -= 1
    runs.append(f"{kept.folder.name[:STAMP]}-begun")
    kept.discard_if_nothing_was_learned(tmp_path)
    assert LearningFolder.find(tmp_path).folder == kept.folder
    runs.pop()
    kept.discard_if_nothing_was_learned(tmp_path)
    assert not (tmp_path / "learning").exists()
    kept.discard_if_nothing_was_learned(tmp_path)  # nothing there: the refusal is what the user has to see


@pytest.mark.parametrize("ended", list(LearningEnd))
def test_only_learning_that_more_rounds_could_change_is_resumed(tmp_path: Path, ended: LearningEnd) -> None:
    kept = LearningFolder.create(tmp_path, TASK, "stroke")
    kept.close(Learned((), ended, "m.yaml", 1, 0.0, RigctlError("why")))
    again = LearningFolder.find(tmp_path)
    if ended in (LearningEnd.DECLINED, LearningEnd.BUDGET, LearningEnd.ROUNDS, LearningEnd.STOPPED):
        again.reopen(rounds=9)
        assert LearningFolder.find(tmp_path).task.rounds == 9
        assert LearningFolder.find(tmp_path).learned is None
    else:
        with pytest.raises(RigctlError, match="this learning session has ended"):
            again.reopen()


def test_resuming_without_stored_state_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="there is nothing to continue"):
        LearningFolder.find(tmp_path)


@pytest.mark.parametrize("text", ["", "{", '{"version": 2}', '{"version": 1, "rounds": []}', "[]"])
def test_a_damaged_state_file_is_reported(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "learning" / "20260101-000000-x"
    folder.mkdir(parents=True)
    (folder / "learning.json").write_text(text)
    with pytest.raises(RigctlError, match="the learning session cannot be read"):
        LearningFolder.find(tmp_path)
