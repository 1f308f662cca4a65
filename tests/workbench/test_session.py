"""A workbench without a page, compared with the commands on the same model files."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

import numpy as np
import pytest

from commands import answer, textbook_copy
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.workbench import Picture, State, Workbench
from rigctl.workbench.session import Cancelled

#: equal numbers: computed in the same way, in another process
SAME = 1e-9
#: two integrations of one model, with and without the states of effects that are off
CLOSE = 1e-3


def switched_on(bench: Workbench, conductance: float = 7e-15) -> State:
    """The textbook with the leak, and another opening."""
    state = bench.start.switched(["valve_leakage"], on=True)
    return state.moved({"valve_leakage.conductance": conductance, "flow_area": 3.9e-6})


def errors(picture: Picture, bench: Workbench) -> dict[str, dict[str, float]]:
    """By channel, in the units that ``compare --json`` has them in."""
    measured = bench.problem.measurements
    units = dict(zip(measured.outputs, measured.units, strict=True))
    return picture.document(units)["channels"]


def test_the_initial_errors_equal_those_of_compare(textbook: Workbench) -> None:
    said = answer("compare", "latest", "--model", "models/hl32-textbook.yaml", "--no-fit")
    picture = textbook.exact
    assert picture.exact
    assert list(picture.records) == list(range(4))
    for name, one in errors(picture, textbook).items():
        for key in ("rmse", "bias", "max", "noise", "nrmse", "chi2_reduced"):
            assert one[key] == pytest.approx(said["channels"][name][key], rel=SAME, abs=1e-9), (name, key)
    assert picture.chi2_reduced == pytest.approx(said["chi2_reduced"], rel=SAME)


def test_a_kept_version_has_the_displayed_state_and_equals_that_of_the_command(shared_results: Path) -> None:
    clicked, typed = textbook_copy("clicked"), textbook_copy("typed")
    bench = Workbench.open([open_run("latest")], Path(clicked), named=clicked)
    state = switched_on(bench)
    seen, command = bench.settle(state), bench.command(state)
    kept = bench.keep(state)
    after = kept.version.done.after
    assert (kept.version.number, after is not None) == (2, True)

    compared = answer("compare", "latest", "--model", clicked, "--no-fit")
    for channel, one in errors(seen, bench).items():
        assert one["rmse"] == pytest.approx(compared["channels"][channel]["rmse"], rel=CLOSE)
        assert one["rmse"] == pytest.approx(after.rmse[channel] if after else None, rel=1e-2)
    shown = {one["name"]: one for one in answer("model", "show", clicked)["parameters"]}
    assert shown["flow_area"]["value"] == pytest.approx(3.9)
    assert shown["flow_area"]["from"].startswith("set by hand")
    assert shown["valve_leakage.conductance"]["value"] == pytest.approx(7e-15)
    first, second = answer("model", "history", clicked)["versions"]
    assert (first["kind"], second["kind"]) == ("start", "set")
    assert "valve_leakage" in second["note"]

    assert command.startswith(f"rigctl model set {clicked} ")
    said = answer(*shlex.split(command.replace(clicked, typed))[1:])
    assert Path(typed).read_text("utf-8") == Path(clicked).read_text("utf-8")
    assert said["after"]["rmse"] == pytest.approx(dict(after.rmse) if after else None, rel=SAME)

    again = bench.reopened()
    assert not again.changes(again.start)
    assert "valve_leakage" in again.start.on


def test_displays_while_a_slider_moves_differ_only_in_record_level_values(
    textbook: Workbench,
) -> None:
    exact = textbook.exact
    still = textbook.follow(textbook.start, budget=math.inf)
    for k in exact.records:
        np.testing.assert_allclose(still.outputs[k], exact.outputs[k], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(still.size[k], exact.size[k], rtol=1e-9)
    nothing = textbook.start.switched(["valve_leakage"], on=True).moved({"valve_leakage.conductance": 0.0})
    through_library = textbook.follow(nothing, budget=math.inf)
    for k in exact.records:
        np.testing.assert_allclose(through_library.size[k], exact.size[k], rtol=CLOSE)
    moved = textbook.follow(switched_on(textbook), [3], budget=0.0)
    assert 3 in moved.records
    assert len(moved.records) < len(exact.records)
    assert np.isnan(moved.size[[k for k in range(4) if k not in moved.records]]).all()
    assert not np.allclose(moved.outputs[3], exact.outputs[3])


def test_obsolete_requests_are_skipped(textbook: Workbench) -> None:
    before = textbook.exact
    with pytest.raises(Cancelled):
        textbook.settle(switched_on(textbook), wanted=lambda: False)
    assert textbook.exact is before


def test_base_physics_is_switched_off_by_its_null_values(textbook: Workbench) -> None:
    (friction,) = [one for one in textbook.switches if one.base and one.on][:1]
    off = textbook.start.switched([friction.name], on=False)
    assert textbook.changes(off).removed == (friction.name,)
    without = textbook.model_of(off)
    for name, nothing in textbook.model.effect(friction.name).base.items():
        assert without.values[name] == nothing
    assert f"--remove {friction.name}" in textbook.command(off)


def test_every_parameter_has_a_slider_whose_range_contains_it(textbook: Workbench) -> None:
    fixed = {one.name for one in textbook.model.family.parameters if one.fixed}
    assert {one.name for one in textbook.sliders} == set(textbook.model.values) - fixed
    for one in (*textbook.sliders, *(s for switch in textbook.switches for s in switch.sliders)):
        assert one.low <= one.value <= one.high, one.name
        assert one.scale == "linear" or one.low > 0.0


def test_effects_that_contradict_one_another_are_refused(textbook: Workbench) -> None:
    pairs = [(s.name, s.instead_of[0]) for s in textbook.switches if s.instead_of]
    one, other = pairs[0]
    with pytest.raises(RigctlError, match="contradict"):
        textbook.model_of(textbook.start.switched([one, other], on=True))


def test_keeping_an_unchanged_state_is_refused_and_writes_nothing(textbook: Workbench, project: Path) -> None:
    before = {path: path.read_bytes() for path in (project / "models").rglob("*") if path.is_file()}
    assert before
    assert textbook.command(textbook.start) == ""
    with pytest.raises(RigctlError, match="nothing differs"):
        textbook.keep(textbook.start)
    assert {path: path.read_bytes() for path in (project / "models").rglob("*") if path.is_file()} == before
