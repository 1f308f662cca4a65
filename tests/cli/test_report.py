"""`rigctl report` as a command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from report.made_campaign import Campaign, make_campaign
from rigctl.cli.main import app

pytestmark = pytest.mark.usefixtures("shared_results")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    small = Campaign(temperatures=(20.0, 30.0), pressures=(30.0,), idle_rows=2)
    make_campaign(tmp_path / "runs", small)
    return tmp_path


def rigctl(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def test_the_report_of_the_latest_run_is_a_page_named_after_it(project: Path) -> None:
    result = rigctl("report", "latest")
    assert result.exit_code == 0, result.output
    assert (project / "20261121-093000-stroke-campaign.html").is_file()
    assert "20261121-093000-stroke-campaign.html" in result.output


def test_the_json_answer_lists_the_files_written(project: Path) -> None:
    result = rigctl(
        "report", "20261121", "-o", "out/page.html", "--figures", "figures", "--format", "svg", "--json"
    )
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["page"] == "out/page.html"
    assert facts["runs"] == ["20261121-093000-stroke-campaign"]
    assert facts["bytes"] == (project / "out" / "page.html").stat().st_size
    assert all((project / figure).is_file() for figure in facts["figures"])
    assert len(facts["figures"]) == 5


def test_a_run_named_twice_is_reported_once(project: Path) -> None:
    result = rigctl("report", "latest", "20261121-093000-stroke-campaign", "--json")
    assert json.loads(result.stdout)["runs"] == ["20261121-093000-stroke-campaign"]


def test_several_runs_have_one_page(project: Path) -> None:
    second = Campaign(run_id="20261122-093000-stroke-campaign", temperatures=(20.0, 30.0), idle_rows=2)
    make_campaign(project / "runs", second)
    result = rigctl("report", "20261121", "20261122")
    assert result.exit_code == 0, result.output
    assert (project / "20261121-093000-stroke-campaign-and-1-more.html").is_file()


def test_an_unknown_run_is_reported_with_the_nearest(project: Path) -> None:
    result = rigctl("report", "20261121-093000-stroke-campain")
    assert result.exit_code != 0
    assert "no such run" in str(result.exception)
    assert "did you mean '20261121-093000-stroke-campaign'?" in str(result.exception)
    assert [path.name for path in project.iterdir()] == ["runs"]


def test_a_report_with_diagnosis_requires_a_model(project: Path) -> None:
    said = str(rigctl("report", "latest", "--diagnose").exception)
    assert "--diagnose needs a model, and none was named" in said
    assert "--model models/hl32-textbook.yaml" in said
    assert not list(project.glob("*.html"))
