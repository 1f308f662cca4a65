"""Which option an error of a command is about: the one whose value it quotes."""

from __future__ import annotations

import pytest
import typer

from rigctl.cli.usage_errors import name_parameters, one_style
from rigctl.errors import RigctlError


@pytest.mark.parametrize(
    ("note", "quoted", "named"),
    [
        ("5", "5", True),
        ("15 May", "5", False),
        ("shift 5", "5", False),
        ("titanium", "tan", False),
        ("a tan cover", "tan", True),
        ("oil > 30 degC", "30 degC", True),
        ("oil > 130 degC", "30 degC", False),
        ("oil.csv", ".", True),
    ],
)
def test_an_error_names_the_option_whose_value_it_quotes(note: str, quoted: str, named: bool) -> None:
    app = typer.Typer()

    @app.command()
    def go(note: str = typer.Option(""), serial: str = typer.Option("")) -> None:
        raise RigctlError("this cannot be", value=quoted)

    command = typer.main.get_command(app)
    name_parameters(command)
    with pytest.raises(RigctlError) as caught:
        command.main(["--serial", "A-77", "--note", note], standalone_mode=False)
    assert caught.value.what == ("--note: this cannot be" if named else "this cannot be")


def test_an_exit_of_a_command_passes() -> None:
    with pytest.raises(typer.Exit), one_style():
        raise typer.Exit(2)
