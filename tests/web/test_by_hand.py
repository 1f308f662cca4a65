"""The bench operated by hand from the page: what opens and moves it, and that every ending leaves it safe."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from rigctl.cli.commands.init import create_project
from rigctl.errors import RigctlError
from rigctl.project import find_project
from rigctl.web import by_hand
from rigctl.web.by_hand import ByHand
from rigctl.web.jobs import Jobs
from rigctl.web.lease import Lease
from rigctl.web.live import Live
from rigctl.web.request_handling import PageRequest
from rigctl.web.server_state import Site
from systems import needs_windows_itself, own_state
from web.serving import Window
from web.watched import wait_for


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hand")
    create_project(folder)
    rig = folder / "rigs" / "hl32-bench.yaml"
    # a busy machine may stop the simulated bench for longer than a second
    rig.write_text(rig.read_text(encoding="utf-8").replace("stale_after: 1 s ", "stale_after: 60 s "))
    return folder


class Bench:
    """The bench as the windows of a server reach it."""

    def __init__(self, folder: Path) -> None:
        self.site = Site(find_project(folder), Jobs(folder))
        self.lease = Lease()
        self.hand = ByHand(self.site, self.lease)

    def ask(self, work: Callable[[PageRequest], Any], viewer: str = "a", **body: object) -> dict[str, Any]:
        answer: dict[str, Any] = work(PageRequest({}, {}, body, viewer))
        return answer

    def state(self, viewer: str = "a") -> dict[str, Any]:
        return self.ask(self.hand.state, viewer)

    def watched(self, viewer: str = "a") -> None:
        """Watch the bench until its readings come."""
        self.ask(self.hand.watch, viewer)
        wait_for(lambda: self.state(viewer)["rows"])

    def ended(self) -> bool:
        return self.hand._command is None


@pytest.fixture
def bench(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    for name, value in own_state(tmp_path).items():
        monkeypatch.setenv(name, value)
    found = Bench(project)
    for viewer in ("a", "b"):
        found.lease.connected(viewer)
    yield found
    found.hand.leave()
    wait_for(found.ended)


def test_nothing_moves_before_the_window_with_the_controls_has_opened_them(bench: Bench) -> None:
    wanted: dict[str, Any] = {"actuator": "valve", "value": "extend", "seconds": 0.2}
    with pytest.raises(RigctlError, match="has not opened the controls"):
        bench.ask(bench.hand.move, **wanted)
    with pytest.raises(RigctlError, match="not watched"):
        bench.ask(bench.hand.open_controls)
    bench.watched()
    with pytest.raises(RigctlError, match="has not opened the controls"):
        bench.ask(bench.hand.move, **wanted)
    for work in (bench.hand.watch, bench.hand.open_controls, bench.hand.move, bench.hand.close):
        with pytest.raises(RigctlError, match="window 1 has the controls"):
            bench.ask(work, "b", **wanted)
    state = bench.state()
    assert not state["open"]
    assert not state["moving"]


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ({"actuator": "valv", "value": "extend", "seconds": 1.0}, "did you mean 'valve'"),
        ({"actuator": "relief_valve", "value": "30 bar", "seconds": 1.0}, "unknown output"),  # turned by hand
        ({"actuator": "valve", "value": "sideways", "seconds": 1.0}, "unknown position"),
        ({"actuator": "valve", "value": "extend", "seconds": 11.0}, "at most 10 s"),
        ({"actuator": "valve", "value": "extend", "seconds": float("nan")}, "at most 10 s"),
        ({"actuator": "valve", "value": "extend", "seconds": True}, "at most 10 s"),
        ({"actuator": "valve", "value": "extend"}, "at most 10 s"),
    ],
)
def test_a_movement_that_the_bench_cannot_take_starts_nothing(
    bench: Bench, body: dict[str, Any], says: str
) -> None:
    with pytest.raises(RigctlError, match=says):
        bench.ask(bench.hand.move, **body)
    assert bench.ended()


def test_a_movement_is_a_jog_after_which_the_bench_is_watched_again(bench: Bench) -> None:
    bench.watched()
    bench.ask(bench.hand.open_controls)
    moved = bench.ask(bench.hand.move, actuator="valve", value="extend", seconds=0.3)
    assert moved == {"command": 'rigctl jog valve extend --for "0.3 s" --rig rigs/hl32-bench.yaml'}
    with pytest.raises(RigctlError, match="a movement is in progress"):
        bench.ask(bench.hand.move, actuator="valve", value="retract", seconds=0.3)
    outputs = set()

    def over() -> bool:
        state = bench.state()
        outputs.add(state["outputs"].get("valve"))
        return bool(state["rows"][-1][-1] is not None and not state["moving"] and "extend" in outputs)

    wait_for(over)
    state = bench.state()
    assert max(row[-1] for row in state["rows"] if row[-1] is not None) > 5.0  # mm
    assert state["outputs"]["valve"] == "neutral"
    assert state["unsafe"] == ""
    assert [one["text"].split()[-1] for one in state["messages"]] == ["extend", "neutral"]
    times = [row[0] for row in state["rows"]]
    assert times == sorted(times)


@needs_windows_itself("Ctrl-Break from one program to another")
@pytest.mark.parametrize("ending", ["gone", "taken over", "stopped", "server"])
def test_every_ending_ends_the_movement(bench: Bench, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    """The window is closed or hangs, another takes the controls, Stop is pressed, the server ends."""
    bench.watched()
    bench.ask(bench.hand.open_controls)
    bench.ask(bench.hand.move, actuator="valve", value="extend", seconds=10.0)
    wait_for(lambda: bench.state()["outputs"].get("valve") == "extend")
    doing = bench.hand._command
    assert doing is not None
    if ending == "gone":
        monkeypatch.setattr(by_hand, "_GONE", 0.5)
        wait_for(bench.ended)
    elif ending == "taken over":
        bench.lease.take("b", over=True)
        wait_for(bench.ended)
    elif ending == "stopped":
        bench.ask(bench.hand.stop, "b")  # from any window
        wait_for(lambda: bench.hand._command is not doing and bench.state()["outputs"])
        assert bench.state()["open"]  # of the window that has the controls
    else:
        for end in bench.site.at_end:
            end()
        wait_for(bench.ended)
    assert by_hand._answer(doing)["unconfirmed"] is None
    assert doing.process.returncode not in (0, None)
    assert "neutral" in bench.state()["messages"][-1]["text"]
    assert bench.state()["unsafe"] == ""


def test_a_movement_that_cannot_be_told_to_end_ends_because_nobody_hears_it(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on Windows without a console; what the command has confirmed is then not heard either."""

    def fail(_: object) -> None:
        raise OSError(6, "The handle is invalid")

    monkeypatch.setattr(by_hand, "_interrupt", fail)
    bench.watched()
    bench.ask(bench.hand.open_controls)
    bench.ask(bench.hand.move, actuator="valve", value="extend", seconds=10.0)
    wait_for(lambda: bench.state()["outputs"].get("valve") == "extend")
    bench.ask(bench.hand.stop)
    wait_for(bench.ended)
    state = bench.state()
    assert "neutral" in state["messages"][-1]["text"]
    assert "valve" in state["unsafe"]
    assert not state["open"]


def test_a_real_bench_is_opened_by_its_name(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(by_hand, "_is_real", lambda _: True)
    for typed in ("", "HL32", "hl32 bench"):
        with pytest.raises(RigctlError, match="opened by its name"):
            bench.ask(bench.hand.open_controls, rig=typed)
    bench.watched()
    assert bench.ask(bench.hand.open_controls, rig="HL32 bench") == {"open": True}


class Silent:
    """A process that says nothing."""

    def poll(self) -> None:
        return None


@pytest.fixture
def stub(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A bench in a project of its own, whose commands are not started."""
    (tmp_path / "rigs").mkdir()
    rig = (project / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")
    for name in ("one", "two"):
        (tmp_path / "rigs" / f"{name}.yaml").write_text(rig.replace("HL32 bench", name), encoding="utf-8")
    (tmp_path / "rigctl.toml").write_text('rig = "rigs/one.yaml"', encoding="utf-8")
    found = Bench(tmp_path)
    found.lease.connected("a")

    def start(words: Sequence[str]) -> None:
        found.hand._command = by_hand._Command(words, Silent())  # type: ignore[arg-type]

    monkeypatch.setattr(found.hand, "_start", start)
    monkeypatch.setattr(by_hand, "_interrupt", lambda _: None)
    yield found
    found.hand._command = None


def test_commands_are_given_the_rig_that_the_page_shows(stub: Bench) -> None:
    """The settings were read once, and the commands read them anew: they moved another bench."""
    assert stub.state()["rig"] == "one"
    (stub.site.project.root / "rigctl.toml").write_text('# anew\nrig = "rigs/two.yaml"', encoding="utf-8")
    assert stub.state()["rig"] == "two"
    assert Live(stub.site).off(PageRequest({}, {}, {}, "a"))["rig"] == "two"
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.open_controls)
    moved = stub.ask(stub.hand.move, actuator="valve", value="extend", seconds=0.5)
    assert moved == {"command": 'rigctl jog valve extend --for "0.5 s" --rig rigs/two.yaml'}


@pytest.mark.parametrize("changed", ["rigs/one.yaml", "rigctl.toml"])
def test_controls_that_were_opened_for_one_bench_move_no_other(stub: Bench, changed: str) -> None:
    """A simulated bench is opened without its name, and its file may lead to a real one a moment later."""
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.open_controls)
    path = stub.site.project.root / changed
    text = path.read_text(encoding="utf-8")
    path.write_text("#\n" + text.replace("kind: simulated", "kind: serial").replace("one", "two"))
    with pytest.raises(RigctlError, match="not the one that was watched"):
        stub.ask(stub.hand.move, actuator="valve", value="extend", seconds=0.5)
    assert not stub.state()["open"]
    assert stub.hand._command is not None
    assert stub.hand._command.asked_to_end
    assert stub.hand._next is None


def test_a_movement_is_not_begun_on_a_bench_that_has_changed_since_it_was_asked_for(stub: Bench) -> None:
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.open_controls)
    stub.ask(stub.hand.move, actuator="valve", value="extend", seconds=0.5)
    (stub.site.project.root / "rigs" / "one.yaml").write_text("name: [", encoding="utf-8")
    doing = stub.hand._command
    assert doing is not None
    stub.hand._ended(doing)
    assert stub.ended()
    assert not stub.hand._opener


def test_a_movement_ends_within_its_longest_time_although_its_level_is_reached_slowly(stub: Bench) -> None:
    """`jog --for` counts from the arrival at a level with a max_rate: 0.5 s could be minutes."""
    path = stub.site.project.root / "rigs" / "one.yaml"
    text = path.read_text(encoding="utf-8")
    for written, instead in (
        ("    by: operator\n", "    max_rate: 1 bar/s\n"),
        ("    prompt: Turn the relief valve until the supply pressure reads\n", ""),
        ("  valve: neutral\n", "  valve: neutral\n  relief_valve: 10 bar\n"),
    ):
        assert written in text
        text = text.replace(written, instead)
    path.write_text(text, encoding="utf-8")
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.open_controls)
    wanted: dict[str, Any] = {"actuator": "relief_valve", "seconds": 0.5}
    with pytest.raises(RigctlError, match=r"30 s to its level.*at most 10 s in all"):
        stub.ask(stub.hand.move, value="40 bar", **wanted)
    stub.ask(stub.hand.move, value="15 bar", **wanted)


def test_everything_off_does_not_depend_on_what_leaves_the_bench(
    stub: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = Live(stub.site)

    def leave() -> None:
        raise OSError(6, "The handle is invalid")

    monkeypatch.setattr(live.by_hand, "leave", leave)
    assert live.off(PageRequest({}, {}, {}, "a"))["confirmed"]


def test_outputs_stay_unconfirmed_until_they_are_confirmed(stub: Bench) -> None:
    """The alert went as soon as the bench was to be watched, before anything had reached it."""
    live = Live(stub.site)
    live.by_hand, hand = stub.hand, stub.hand
    stub.ask(hand.watch)
    doing = hand._command
    assert doing is not None
    doing.words, doing.samples = ("jog", "--", "heater", "on"), 1
    hand._ended(doing)
    assert stub.state()["unsafe"].startswith("heater")
    stub.ask(hand.watch)
    settings = stub.site.project.root / "rigctl.toml"
    settings.write_text('# another bench\nrig = "rigs/two.yaml"', encoding="utf-8")
    stub.ask(live.off)
    settings.write_text("rig = 1", encoding="utf-8")
    assert stub.state()["unsafe"].startswith("heater")
    settings.write_text('rig = "rigs/one.yaml"', encoding="utf-8")
    stub.ask(live.off)
    assert stub.state()["unsafe"] == ""


def test_a_movement_can_be_stopped_before_it_has_begun(stub: Bench) -> None:
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.open_controls)
    stub.ask(stub.hand.move, actuator="valve", value="extend", seconds=0.5)
    assert stub.state()["moving"]
    stub.ask(stub.hand.stop, "b")
    assert not stub.state()["moving"]


def test_an_output_rests_for_its_min_interval_between_two_movements(stub: Bench) -> None:
    """Each movement is a process of its own, which knows of no earlier one."""
    stub.ask(stub.hand.watch)
    doing = stub.hand._command
    assert doing is not None
    doing.words, doing.samples, doing.answer = ("jog", "--", "heater", "on"), 1, ['{"unconfirmed": null}']
    stub.ask(stub.hand.open_controls)
    stub.hand._ended(doing)
    with pytest.raises(RigctlError, match="switched a moment ago") as refused:
        stub.ask(stub.hand.move, actuator="heater", value="on", seconds=0.5)
    assert "min_interval is 2 s" in str(refused.value.hint)
    stub.ask(stub.hand.move, actuator="valve", value="extend", seconds=0.5)


def test_controls_of_a_bench_that_is_being_left_are_not_opened(stub: Bench) -> None:
    stub.ask(stub.hand.watch)
    stub.ask(stub.hand.close)
    with pytest.raises(RigctlError, match="not watched"):
        stub.ask(stub.hand.open_controls)


def test_the_only_rig_of_a_project_is_its_bench(project: Path, tmp_path: Path) -> None:
    """A project of `rigctl init --minimal` names none, and 'Everything off' asked which is meant."""
    create_project(tmp_path / "lab", minimal=True)
    (tmp_path / "lab" / "rigs" / "line-device.yaml").unlink()
    rig = (project / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")
    for number in range(2):
        (tmp_path / "lab" / "rigs" / f"bench-{number}.yaml").write_text(rig, encoding="utf-8")
        live = Live(Site(find_project(tmp_path / "lab"), Jobs(tmp_path)))
        asked = PageRequest({}, {}, {}, "a")
        if number:
            with pytest.raises(RigctlError, match="which bench is meant"):
                live.off(asked)
            assert live.by_hand.state(asked)["rig"] is None
        else:
            assert live.off(asked)["rig"] == "HL32 bench"
            assert live.by_hand.state(asked)["rig"] == "HL32 bench"


def test_a_movement_whose_program_was_killed_is_said_to_be_unsafe(bench: Bench) -> None:
    bench.watched()
    bench.ask(bench.hand.open_controls)
    bench.ask(bench.hand.move, actuator="heater", value="on", seconds=10.0)
    wait_for(lambda: bench.state()["outputs"].get("heater") == "on")
    doing = bench.hand._command
    assert doing is not None
    doing.process.kill()
    wait_for(bench.ended)
    state = bench.state()
    assert state["unsafe"].startswith("heater")
    assert not state["open"]  # and nothing has begun again
    assert not state["watched"]
    bench.watched()  # its first reading follows the safe state
    assert bench.state()["unsafe"] == ""


def test_a_bench_is_left_although_no_signal_can_be_sent(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows without a console; the command then ends because its readings are not taken any more."""

    def interrupt(_: object) -> None:
        raise OSError(6, "The handle is invalid")

    monkeypatch.setattr(by_hand, "_interrupt", interrupt)
    bench.watched()
    doing = bench.hand._command
    assert doing is not None
    bench.ask(bench.hand.close)
    wait_for(bench.ended)
    assert doing.process.returncode is not None


def test_a_jog_whose_readings_nobody_takes_ends(project: Path, tmp_path: Path) -> None:
    """So it does when the server is killed."""
    command = [
        sys.executable,
        "-m",
        "rigctl",
        "jog",
        "valve",
        "extend",
        "--for",
        "60 s",
        "--readings",
        "--json",
    ]
    with subprocess.Popen(
        command,
        cwd=project,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        stdin=subprocess.DEVNULL,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        for line in process.stdout:
            if '"valve": "extend"' in line:
                break
        process.stdout.close()
        said = process.stderr.read()
        assert process.wait(60) != 0
    assert "valve neutral" in said


def test_the_page_watches_and_moves_the_bench_and_draws_one_channel_over_another(window: Window) -> None:
    page = window.open("/live")
    page.set_viewport_size({"width": 1400, "height": 1600})
    hand = page.get_by_role("region", name="The bench by hand")
    hand.get_by_role("button", name="Watch the bench").click()
    page.locator("[data-channel=position] canvas").wait_for()
    hand.get_by_text("rigctl monitor").wait_for()
    page.locator("[data-channel=supply_pressure] h3").drag_to(page.locator("[data-channel=position] .u-over"))
    page.get_by_role("region", name="position over supply_pressure").locator("canvas").wait_for()
    page.get_by_label("over", exact=True).select_option("oil_temperature")  # without a mouse
    page.get_by_role("region", name="position over oil_temperature").wait_for()
    assert hand.get_by_role("button", name="valve extend").count() == 0
    hand.get_by_role("button", name="Open the controls").click()
    hand.get_by_role("button", name="valve extend").click()
    hand.get_by_text('rigctl jog valve extend --for "0.5 s"').wait_for()
    page.locator("[data-command=valve]", has_text="extend").wait_for()
    hand.get_by_role("button", name="Leave it").click()
    hand.get_by_role("button", name="Watch the bench").wait_for()
    page.close()
