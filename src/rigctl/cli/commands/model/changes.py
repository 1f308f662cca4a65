"""Change a model file from a command, and report the change of the error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigctl.analysis.search.model_change import Wanted, change_model
from rigctl.answers.model.change import change_answer
from rigctl.cli.blocks import show, show_answer
from rigctl.cli.echo import print_json
from rigctl.cli.named_input import open_runs
from rigctl.cli.progress import progress_display
from rigctl.effects import Effect
from rigctl.effects.option import read_effect_option
from rigctl.effects.user import is_effect_file
from rigctl.model import Model, load_model
from rigctl.project import find_file


def carry_out(
    path: Path,
    wanted: Wanted,
    runs: Sequence[str],
    *,
    family: str | None,
    as_json: bool,
    verbose: bool = False,
) -> None:
    """Change the model file `path`, and show the change of the error.

    `family` is as given, for the next command.

    Raises
    ------
    RigctlError
        the records or the model are not suitable.
    """
    with progress_display("Reading the records", "nothing was saved") as on_progress:
        opened = open_runs(runs, load_model(path), wanted.assume) if runs else []
        changed = change_model(path, wanted, opened, on_progress=on_progress)
    if as_json:
        print_json(changed.document())
        return
    answer, evidence = change_answer(changed, family, evidence=verbose)
    show_answer(answer)
    show(evidence)


def read_effect(model: Model, written: str) -> tuple[Effect, dict[str, float], tuple[Path, ...]]:
    """The effect of ``EFFECT[:param=value,...]``, its parameters in SI, and the files it comes from."""
    if ":" not in written and not is_effect_file(written):
        effect = model.effect(written)
        return effect, {} if effect.base else effect.start, ()
    parameters = {name: value for name, value in model.values.items() if "." not in name}
    effect, values = read_effect_option(written, model.family, parameters)
    from_file = is_effect_file(written.partition(":")[0])
    return effect, values, (find_file(Path(written.partition(":")[0])),) if from_file else ()
