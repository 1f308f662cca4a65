"""`rigctl frequency`, from a user's log to the answer, beside SciPy's own benches and closed forms."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from commands import answer, refusal, told
from rigctl.analysis.fitting import fit_to_data, read_runs
from rigctl.analysis.frequency_response import frequency_responses, responses_of_fit
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.model.load import load_model
from rigctl_validation.real.logs import FOLDER_VARIABLE, data_folder, find_log
from rigctl_validation.real.tables import training_lines
from rigctl_validation.real.work import _imported
from swing import FAMILY, MODEL, RIG

Floats = NDArray[np.float64]

#: the bench: a mass of 1 kg on a spring
STIFFNESS, DAMPING = 3.6, 0.2
STEP, NOISE = 0.1, 0.005


def closed_form(frequencies: Floats) -> Floats:
    """m/N, by SciPy."""
    return np.asarray(signal.freqs([1.0], [1.0, DAMPING, STIFFNESS], 2.0 * np.pi * frequencies)[1])


def position(force: Floats, cubic: float = 0.0) -> Floats:
    """(n) exact for forces that hold from sample to sample; with a cubic spring by small steps."""
    dynamics = np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]])
    system = (dynamics, np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    fine = 20 if cubic else 1
    a, b, *_ = signal.cont2discrete(system, STEP / fine)
    state, found = np.zeros(2), np.empty(force.size)
    for k in range(force.size):
        found[k] = state[0]
        for _ in range(fine):
            state = a @ state + b[:, 0] * (force[k] - cubic * state[0] ** 3)
    return found


def periodic(periods: int) -> Floats:
    """A multisine of 16 lines with random phases, which nobody of this project drew."""
    rng = np.random.default_rng(2)
    time = STEP * np.arange(512)
    lines = np.arange(1, 33, 2)
    phases = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    once = sum(0.3 * np.cos(2.0 * np.pi * k * time / 51.2 + p) for k, p in zip(lines, phases, strict=True))
    return np.tile(np.asarray(once), periods)


def project(folder: Path, force: Floats, cubic: float = 0.0) -> None:
    create_project(folder)
    for name, text in (("families", FAMILY), ("rigs", RIG % ""), ("models", MODEL)):
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "swing.yaml").write_text(text, encoding="utf-8")
    noise = NOISE * np.random.default_rng(7).standard_normal(force.size)
    rows = np.column_stack([STEP * np.arange(force.size), force, position(force, cubic) + noise])
    np.savetxt(folder / "log.csv", rows, "%.7g", ",", header="time [s],force [N],position [m]", comments="")
    told("import", "log.csv", "--rig", "rigs/swing.yaml")


def gains(lines: list[dict[str, object]], of: str = "") -> NDArray[np.complex128]:
    each = [one[of] if of else one for one in lines]
    return np.array([one["magnitude"] * np.exp(1j * np.radians(one["phase"])) for one in each])  # type: ignore[index]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "bench"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def test_a_periodic_log_gives_the_lines_of_the_closed_form_and_a_fitted_model_too(here: Path) -> None:
    project(here, periodic(6))
    (one,) = answer("frequency", "latest")["responses"]
    assert (one["input"], one["output"], one["unit"]) == ("force", "position", "m/N")
    assert (one["method"], one["segments"], one["periods_left_out"]) == ("periods", 5, 1)
    assert one["period"] == pytest.approx(51.2, abs=1e-6)
    shown = [line for line in one["lines"] if line["shown"]]
    frequencies = np.array([line["frequency"] for line in shown])
    assert frequencies[:12] == pytest.approx(np.arange(1, 24, 2) / 51.2)
    # a logger knows the times of its commands to within a sample: half of one on average, late or early
    late = np.exp(2j * np.pi * frequencies * STEP * np.linspace(-0.5, 0.5, 101)[:, None])
    radius = np.array([line["radius"] for line in shown])
    distances = np.abs(gains(shown) * late - closed_form(frequencies)) / radius
    assert (distances < 1.0).mean(axis=1).max() > 0.85
    assert min(line["coherence"] for line in shown[:8]) > 0.99

    document = answer("frequency", "latest", "--model", "models/swing.yaml")
    (one,) = document["responses"]
    assert one["model"] == "swing"
    assert not any(line["differs"] for line in one["lines"])
    assert "is the measured one" in one["statement"]
    model = np.abs(gains([line for line in one["lines"] if line["shown"]], "of_model"))
    assert model[:10] == pytest.approx(np.abs(closed_form(frequencies[:10])), rel=0.03)


def test_a_model_with_another_spring_is_another_response(here: Path) -> None:
    project(here, periodic(6))
    said = told("frequency", "latest", "--model", "models/swing.yaml", "--no-fit", "-v")
    assert "the response of swing from force to position is not the measured one at" in said
    assert "excited lines, most at 0.3" in said  # the bench's resonance lies at 0.30, the model's at 0.32 Hz
    assert "Next: rigctl diagnose latest --model models/swing.yaml" in said


def test_a_cubic_spring_lowers_the_coherence_and_is_seen_by_windows(here: Path) -> None:
    rng = np.random.default_rng(3)
    force = np.repeat(rng.choice([-1.0, 1.0], 1500), 4)
    project(here, force, cubic=6.0)
    (one,) = answer(
        "frequency", "latest", "--model", "models/swing.yaml", "--no-fit", "--resolution", "20 mHz"
    )["responses"]
    assert one["method"] == "windows" and one["averages"] > 20
    assert one["resolution"] == pytest.approx(0.02)
    shown = [line for line in one["lines"] if line["shown"]]
    middle = [line["coherence"] for line in shown if 0.2 < line["frequency"] < 0.5]
    assert 0.3 < np.median(middle) < 0.98
    assert any(line["differs"] for line in one["lines"])


def test_the_page_has_a_bode_plot_and_is_also_on_that_of_a_comparison(here: Path) -> None:
    project(here, periodic(4))
    told("frequency", "latest", "--model", "models/swing.yaml", "-o", "bode.html")
    told("compare", "latest", "--model", "models/swing.yaml", "-o", "page.html")
    for name in ("bode.html", "page.html"):
        page = Path(name).read_text(encoding="utf-8")
        assert "Frequency response from force to position, with 95 % intervals" in page
        assert '"type":"log"' in page
        assert "magnitude [dB re 1 m/N]" in page
        assert "coherence" in page


def test_what_shows_no_response_says_why(here: Path) -> None:
    project(here, np.full(2000, 0.5))
    assert "no input moves in these records" in refusal("frequency", "latest")
    assert "does not move in these records" in refusal("frequency", "latest", "--input", "force")
    assert "unknown input, got 'forse'; did you mean 'force'?" in refusal(
        "frequency", "latest", "--input", "forse"
    )
    assert "did you mean 'position'?" in refusal("frequency", "latest", "--channel", "positon")
    # a record in which the reading does not follow
    rng = np.random.default_rng(4)
    rows = np.column_stack(
        [STEP * np.arange(2000), np.repeat(rng.choice([-1.0, 1.0], 500), 4), rng.standard_normal(2000)]
    )
    np.savetxt("other.csv", rows, "%.7g", ",", header="time [s],force [N],position [m]", comments="")
    told("import", "other.csv", "--rig", "rigs/swing.yaml")
    (one,) = answer("frequency", "latest")["responses"]
    assert not any(line["shown"] for line in one["lines"])
    assert one["statement"].startswith("these records do not show how position follows force")


PROCEDURE = """
procedure: both
rig: rigs/heater-board.yaml
steps:
  - record: {name: both, rate: 2 Hz}
    do:
      - waveform:
          actuator: heater_1
          multisine: {mean: 50 %, from: 10 mHz, to: 50 mHz, amplitude: 40 %}
          repeat: 3
  - set: {heater_2: 30 %}
  - wait: 1 s
"""


def test_a_command_with_the_last_sample_of_a_record_is_no_other_input(here: Path) -> None:
    """It used to be taken out, and in records of one shape the excitation with it."""
    create_project(here)
    Path("procedures/both.yaml").write_text(PROCEDURE, encoding="utf-8")
    told("simulate", "procedures/both.yaml", "--seed", "1")
    responses = answer("frequency", "latest")["responses"]
    assert [(one["input"], one["output"]) for one in responses] == [
        ("heater_1", "temperature_1"),
        ("heater_1", "temperature_2"),
    ]
    assert all(one["other_inputs"] == [] for one in responses)
    said = told("frequency", "latest")
    assert "temperature_1 follows heater_1 from 0.01 to 0.05 Hz" in said
    assert "no response is shown\n  of temperature_2 to heater_1: no line has a coherence" in said
    (line,) = [line for line in told("check", "procedures/both.yaml").splitlines() if "multisine" in line]
    assert "5 lines from 0.01 to 0.05 Hz, period 100 s, crest factor 1." in line


def test_wrong_calls_are_one_message_each(here: Path) -> None:
    project(here, periodic(2)[:700])
    for words, said in [
        (["--resolution", "3 s"], "wrong dimension"),
        (["--resolution", "0.1 mHz"], "too short for a frequency response, got '700 samples of position at"),
        (["--resolution", "0 Hz"], "0 Hz"),
        (["--resolution", "2 Hz"], "too coarse for these records, got '2 Hz'; expected at most 0.625 Hz"),
        (["--only", "record +"], "record"),
        (["--only", "record == 7"], "no record is chosen by this"),
        (["--only", "record"], "chosen by a condition"),
        (["--assume", "force=1 N"], "no model was named"),
        (["--model", "models/swing.yaml", "--input", "heater"], "heater"),
    ]:
        assert said in refusal("frequency", "latest", *words)
    assert told("frequency", "latest", "--only", "record == 1")


def test_the_resolution_of_a_call_from_python_is_checked_too(here: Path) -> None:
    project(here, periodic(2)[:700])
    (folder,) = Path().rglob("run.json")
    with pytest.raises(RigctlError, match="a resolution is a frequency above zero"):
        frequency_responses([open_run(folder.parent)], resolution=0.0)


@pytest.mark.parametrize("apart", [1e-9, 0.04], ids=["coincident", "apart"])
def test_devices_with_rows_of_their_own_give_the_same_as_common_rows(here: Path, apart: float) -> None:
    force = periodic(3)
    project(here, force)
    (alone,) = answer("frequency", "latest")["responses"]
    rig = (RIG % "").replace("actuators:", "  room: {unit: m, quantity: position}\nactuators:")
    Path("rigs/swing.yaml").write_text(rig, encoding="utf-8")
    lines = Path("log.csv").read_text(encoding="utf-8").splitlines()
    rows = [lines[0] + ",room [m]"]
    for number, line in enumerate(lines[1:]):
        pushed = line.split(",")[1]
        time = STEP * number + apart
        rows += [line + ",", f"{time:.10f},{pushed},,{np.sin(0.7 * number):.6f}"]
    Path("two.csv").write_text("\n".join(rows), encoding="utf-8")
    told("import", "two.csv", "--rig", "rigs/swing.yaml")
    (found,) = answer("frequency", "latest", "--channel", "position")["responses"]
    assert (found["segments"], found["period"]) == (alone["segments"], pytest.approx(alone["period"]))
    # a command is logged in more rows, and its changes are known better
    assert np.abs(gains(found["lines"])) == pytest.approx(np.abs(gains(alone["lines"])), rel=0.01)
    # a channel of one device as the input of another's
    (of_reading,) = answer("frequency", "latest", "--input", "room", "--channel", "position")["responses"]
    assert of_reading["lines"]


def test_a_page_is_written_without_a_frequency_response_that_fails(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_memory(*_: object) -> None:
        raise MemoryError("Unable to allocate 74.5 GiB")

    project(here, periodic(3))
    monkeypatch.setattr("rigctl.analysis.frequency_response.estimate", without_memory)
    told("compare", "latest", "--model", "models/swing.yaml", "-o", "page.html")
    assert "could not be estimated: Unable to allocate 74.5 GiB" in Path("page.html").read_text("utf-8")


def test_a_model_that_ignores_the_input_is_said_to(here: Path) -> None:
    project(here, periodic(4))
    family = Path("families/swing.yaml")
    text = family.read_text(encoding="utf-8")
    family.write_text(text.replace("(force - stiff", "(0*force - stiff"), encoding="utf-8")
    words = ("frequency", "latest", "--model", "models/swing.yaml", "--no-fit", "-v", "-o", "page.html")
    said = told(*words)
    assert "there the model's position does not follow force (by less than a thousandth" in said
    assert "inf" not in said and "nan" not in said


@pytest.mark.skipif(FOLDER_VARIABLE not in os.environ, reason="published logs are not part of the project")
def test_published_logs_show_a_known_resonance_and_a_dead_time(tmp_path: Path) -> None:
    """The silverbox resonates at some 70 Hz; the dryer's phase falls further than a first-order lag's."""
    log = find_log("silverbox")
    run = _imported(log, training_lines(log, data_folder()), tmp_path, "log")
    (one,) = frequency_responses([run])
    size = np.where(one.shown, np.abs(one.measured.gain), 0.0)
    assert one.spectrum.frequencies[np.argmax(size)] == pytest.approx(68.8, abs=3.0)
    assert np.median(one.measured.coherence[one.shown]) > 0.99

    log, folder = find_log("dryer"), tmp_path / "dryer"
    folder.mkdir()
    run = _imported(log, training_lines(log, data_folder()), folder, "log")
    model = load_model(folder / "model.yaml")
    (one,) = responses_of_fit(fit_to_data(model, read_runs(model, [run])), model.name)
    assert one.predicted is not None
    early = one.shown & (one.spectrum.frequencies < 2.0)
    lead = np.unwrap(np.angle(one.predicted.gain[early] / one.measured.gain[early]))
    slope = np.polyfit(one.spectrum.frequencies[early], lead, 1)[0] / (2.0 * np.pi)
    assert 0.08 < slope < 0.25  # s: two to three samples of 0.08 s, in the literature
    assert one.differing.sum() > 0.8 * one.spectrum.excited.sum()
