"""Jobs in separate processes: their results, errors, cancellation and crashes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rigctl.errors import RigctlError
from rigctl.web.jobs import Job, Jobs
from web.watched import wait_for
from web.work import dying, endless, faulty, measured, mistaken


@pytest.fixture(scope="module")
def jobs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Jobs]:
    made = Jobs(tmp_path_factory.mktemp("work"))
    yield made
    made.close()


def ended(job: Job) -> Job:
    wait_for(lambda: job.state != "working")
    return job


def test_the_result_of_a_job_is_kept(jobs: Jobs) -> None:
    folder = str(jobs._folder.resolve())
    job = ended(jobs.start("Measure", "rigctl measure", measured, folder))
    told = jobs.find(job.id).document()
    assert told["state"] == "done"
    assert told["result"] == {"here": True, "nan": None}
    assert told["partial"] == {"so far": 1}
    assert told["share"] == 1.0


def test_errors_faults_and_crashes_of_jobs_are_reported(jobs: Jobs) -> None:
    wrong, broken, dead = (jobs.start("x", "x", work) for work in (mistaken, faulty, dying))
    assert ended(wrong).state == "failed"
    assert (wrong.error or {})["nearest"] == "y"
    assert "ZeroDivisionError" in str((ended(broken).error or {})["what"])
    assert ended(dead).state == "died"
    assert "ended without a message" in str((dead.error or {})["what"])


def test_jobs_can_be_stopped_and_are_limited_in_number(jobs: Jobs) -> None:
    first = [jobs.start("x", "x", endless) for _ in range(3)]
    with pytest.raises(RigctlError, match="3 pieces of work"):
        jobs.start("x", "x", endless)
    for job in first:
        assert jobs.stop(job.id).state == "stopped"
    wait_for(lambda: not jobs._processes)


def test_a_command_job_succeeds_fails_or_crashes(jobs: Jobs) -> None:
    listed = jobs.start_command("Runs", ["runs", "list"])
    wrong = jobs.start_command("Runs", ["runs", "show", "nothing"])
    (jobs._folder / "rigctl.toml").write_text("", encoding="utf-8")
    steps = "procedure: p\nrig: rigs/heater-board.yaml\nsteps: [wait: 1 h]\n"
    (jobs._folder / "p.yaml").write_text(steps, encoding="utf-8")
    killed = jobs.start_command(
        "Simulate", ["simulate", "p.yaml", "--speed", "1x"]
    )  # this job does not end by itself
    jobs._processes[killed.id].kill()
    assert ended(listed).document()["result"] == {"runs": []}
    assert listed.command == "rigctl runs list"
    assert ended(wrong).state == "failed"
    assert (wrong.error or {})["value"] == "nothing"
    assert ended(killed).state == "died"
