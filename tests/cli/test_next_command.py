"""The next command suggested by an answer."""

from __future__ import annotations

import shlex

import pytest

from rigctl.cli.next_command import page_of, show_next
from rigctl.command_line import DataOptions, analysis, quoted, shell_word


def test_the_next_command_keeps_the_selection_of_records() -> None:
    told = analysis("diagnose", ["latest"], "my models/a.yaml", DataOptions("oil > 30 degC", "record > 3"))
    chosen = '--only "oil > 30 degC" --hold-out "record > 3"'
    assert told == f'rigctl diagnose latest --model "my models/a.yaml" {chosen}'


def test_commands_in_sequence_and_quotes_work_in_the_shell_of_each_system(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show_next("rigctl model remove a.yaml fan\nrigctl model add a.yaml fan.yaml", "adds it in place of fan")
    assert capsys.readouterr().out.splitlines() == [
        "",
        "Next: rigctl model remove a.yaml fan",
        "      rigctl model add a.yaml fan.yaml",
        "  adds it in place of fan",
    ]
    assert quoted("it's $5", windows=True) == "'it''s $5'"
    assert quoted("oil > 30 degC", windows=True) == '"oil > 30 degC"'
    assert shlex.split(quoted("it's $5", windows=False)) == ["it's $5"]


def test_a_path_typed_on_windows_is_repeated_with_forward_slashes() -> None:
    assert shell_word(r"models\hl32.yaml", windows=True) == "models/hl32.yaml"
    assert shell_word(r"\\lab\share\my runs", windows=True) == '"//lab/share/my runs"'
    assert shell_word(r"a\b", windows=False) == r"a\b"


def test_the_next_command_names_the_family_of_the_user() -> None:
    told = analysis("diagnose", ["latest"], "a.yaml", DataOptions(family="my families/tank.py"))
    assert told == 'rigctl diagnose latest --model a.yaml --family "my families/tank.py"'


def test_the_suggested_page_covers_the_records_of_the_answer() -> None:
    assert page_of("compare", ["latest"], "a.yaml") == "rigctl report latest --model a.yaml"
    assert page_of("diagnose", ["latest"], "a.yaml") == "rigctl report latest --model a.yaml --diagnose"
    chosen = page_of("compare", ["latest"], "a.yaml", DataOptions(hold_out="record > 3"))
    assert chosen == 'rigctl compare latest --model a.yaml --hold-out "record > 3" -o page.html'
    own = page_of("diagnose", ["latest"], "a.yaml", None, "--max-effects", "1")
    assert own == "rigctl diagnose latest --model a.yaml --max-effects 1 -o page.html"
