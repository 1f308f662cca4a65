"""`import rigctl` is fast, and its public names exist, are documented and work."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest

import rigctl
import rigctl.dataset
import rigctl.public_names
from rigctl.notebook import as_html
from rigctl.runner.simulation import Simulation

ROOT = Path(__file__).parents[1]

HEAVY = ("numpy", "pandas", "pyarrow", "duckdb", "pint", "pydantic", "numba", "scipy", "plotly")


def test_importing_rigctl_imports_no_heavy_library() -> None:
    program = f"import rigctl, sys; print([name for name in {HEAVY} if name in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"


def test_public_names_are_the_objects_of_the_packages_and_are_listed_by_dir() -> None:
    assert rigctl.open_run is rigctl.dataset.open_run
    assert set(rigctl.__all__) <= set(dir(rigctl))


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="open_rum"):
        _ = rigctl.open_rum


def test_the_table_of_public_names_matches_the_imports_for_type_checkers() -> None:
    tree = ast.parse(Path(rigctl.__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    read = {
        alias.asname: (node.module, alias.name) for node in imports for alias in node.names if alias.asname
    }
    assert {*read, "Family"} == rigctl.public_names.PUBLIC.keys()
    for name, (module, there) in read.items():
        assert getattr(rigctl, name) is getattr(import_module(str(module)), there)


def test_every_public_name_is_used_in_the_type_checked_file() -> None:
    text = (ROOT / "tests" / "public_typing.py").read_text(encoding="utf-8")
    assert [name for name in rigctl.__all__ if f"    rigctl.{name},\n" not in text] == []


@pytest.mark.parametrize("name", ["compare", "diagnose"])
def test_actions_are_functions_and_shadow_no_package(name: str) -> None:
    program = (
        f"import rigctl, rigctl.cli.main, rigctl.cli.commands.{name}, inspect; from rigctl import {name}; "
        f"takes = inspect.signature({name}).parameters; "
        f"print(type({name}).__name__, rigctl.{name} is {name}, 'runs' in takes)"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["function", "True", "True"]


def test_no_module_is_callable() -> None:
    modules = [module for name, module in sys.modules.items() if name.startswith("rigctl")]
    assert [module for module in modules if callable(module)] == []


def test_every_public_name_is_documented() -> None:
    for name in rigctl.__all__:
        public = getattr(rigctl, name)
        assert inspect.getdoc(public), name


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return rigctl.simulate(
        ROOT / "procedures" / "quick-check.yaml", runs=tmp_path_factory.mktemp("runs"), seed=3
    )


def test_every_repr_is_one_line(recorded: Simulation) -> None:
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    procedure = rigctl.load_procedure(ROOT / "procedures" / "campaign.yaml")
    rig = rigctl.load_rig(procedure.rig_path)
    plan = rigctl.expand(procedure, rig)
    effect = rigctl.find_effect("piston_leakage", "hydraulic_cylinder")
    shown = [
        recorded,
        recorded.result,
        recorded.run,
        model,
        procedure,
        rig,
        plan,
        rigctl.preview(plan),
        effect,
        effect.model_family,
    ]
    for thing in shown:
        line = repr(thing)
        assert line.startswith(f"<{type(thing).__name__} ")
        assert len(line) <= 160
        assert "\n" not in line


def test_a_model_has_text_and_notebook_representations(recorded: Simulation) -> None:
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    frame = model.frame().set_index("parameter")
    assert frame.loc["bore", "value"] == pytest.approx(50.0)
    assert frame.loc["bore", "unit"] == "mm"
    assert set(frame.index[frame["free"]]) == set(model.fitted)
    assert "<table" in model._repr_html_()
    assert model.name in model.summary()


def test_user_text_is_escaped_in_notebooks() -> None:
    table = pd.DataFrame({"name": ["<script>"]})
    assert "<script>" not in as_html("<script>", table)


def test_runs_are_found_by_procedure_and_status(recorded: Simulation) -> None:
    runs = recorded.run.folder.parent
    assert [one.id for one in rigctl.find_runs(runs=runs)] == [recorded.run.id]
    assert rigctl.find_runs(runs=runs, procedure="another") == []
    assert [one.id for one in rigctl.find_runs(runs=runs, status="finished")] == [recorded.run.id]


def test_a_real_bench_needs_an_operator(tmp_path: Path) -> None:
    with pytest.raises(rigctl.RigctlError, match="somebody has to answer"):
        rigctl.run(ROOT / "procedures" / "quick-check.yaml", backend="serial", runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_backend_is_named_with_the_nearest(tmp_path: Path) -> None:
    """It was taken for a real bench that needs an operator."""
    with pytest.raises(rigctl.RigctlError, match="did you mean 'simulated'") as caught:
        rigctl.run(ROOT / "procedures" / "quick-check.yaml", backend="simulatd", runs=tmp_path)
    assert caught.value.what == "unknown backend"


def test_a_simulated_bench_runs_from_python(tmp_path: Path) -> None:
    result = rigctl.run(
        ROOT / "procedures" / "quick-check.yaml", backend="simulated", speed="max", runs=tmp_path
    )
    assert (result.status, result.records) == ("finished", 2)


def test_a_fit_from_python_equals_the_fit_of_a_comparison(tmp_path: Path) -> None:
    model = rigctl.load_model(ROOT / "models" / "hl32-oil.yaml")
    imported = rigctl.import_file(ROOT / "data" / "hl32-viscosity.csv", None, tmp_path)
    run = rigctl.open_run(imported.path)
    found = rigctl.fit([run], model)
    compared = rigctl.compare([run], [model])
    assert found.values.tolist() == compared.models[0].fit.values.tolist()
    assert list(found.frame()["parameter"]) == list(model.fitted)
    assert repr(found).startswith("<FitResult hl32-oil: ")
    assert repr(compared).startswith("<Comparison of 1 run: hl32-oil")


def calls(page: str) -> list[tuple[str, str]]:
    """Public functions as a page writes them in its text, and their arguments."""
    return [(name, inside) for name, inside in re.findall(r"`(?:\w+\.)*(\w+)\(([^`]*)\)`", page) if inside]


def test_arguments_and_defaults_shown_in_the_documentation_are_those_of_the_functions() -> None:
    checked = 0
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for name, inside in calls(page.read_text(encoding="utf-8")):
            function = getattr(rigctl, name, None)
            if not inspect.isfunction(function):
                continue
            known = inspect.signature(function).parameters
            for argument, default in re.findall(r"(\w+)=(\w+|\(\))", inside):
                assert argument in known, f"{page.stem}: {name} takes no {argument}"
                assert repr(known[argument].default) == default, f"{page.stem}: {name}: {argument}"
                checked += 1
    assert checked


def test_an_unknown_effect_to_exclude_is_refused(recorded: Simulation) -> None:
    """A misspelt name excluded nothing, without a word."""
    model = rigctl.load_model(ROOT / "models" / "hl32-textbook.yaml")
    for asked in (
        lambda names: rigctl.compare([recorded.run], [model], excluded=names),
        lambda names: rigctl.diagnose([recorded.run], model, excluded=names),
    ):
        with pytest.raises(rigctl.RigctlError, match="did you mean 'piston_leakage'") as caught:
            asked(["piston_leakge"])
        assert caught.value.what == "unknown effect to exclude"


def test_paths_may_be_text(recorded: Simulation, tmp_path: Path) -> None:
    """They were for loading, and an AttributeError for writing."""
    page, figures = tmp_path / "page.html", tmp_path / "figures"
    assert rigctl.write_report([recorded.run], str(page), figures=str(figures)).page == page
    assert list(figures.iterdir())
    rigctl.export_run(recorded.run, str(tmp_path / "samples.csv"))
    imported = rigctl.import_file(str(ROOT / "data" / "hl32-viscosity.csv"), None, str(tmp_path / "runs"))
    assert imported.path.is_dir()


def test_an_unknown_format_of_figures_is_refused_before_the_page(
    recorded: Simulation, tmp_path: Path
) -> None:
    """It was written in any format of the plotting library, or ended in its error after the page."""
    page = tmp_path / "page.html"
    with pytest.raises(rigctl.RigctlError, match="unknown format of figures, got 'jpg'"):
        rigctl.write_report([recorded.run], page, figures=tmp_path / "figures", form="jpg")
    assert not page.exists()


def test_unknown_tables_and_no_records_are_refused(recorded: Simulation, tmp_path: Path) -> None:
    with pytest.raises(rigctl.RigctlError, match="unknown table, got 'sample'; did you mean 'samples'"):
        recorded.run.table("sample")
    with pytest.raises(rigctl.RigctlError, match="no records are chosen"):
        rigctl.export_run(recorded.run, tmp_path / "none.csv", records=[])
    assert list(tmp_path.iterdir()) == []
