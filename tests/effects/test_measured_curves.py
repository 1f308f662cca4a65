"""A measured curve as an effect: SciPy's monotone cubic inside, level beyond, with an uncertainty band."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

import commands
from rigctl.effects import Effect, qualified
from rigctl.effects.drivers import drivers
from rigctl.effects.user import parse_effect
from rigctl.errors import RigctlError
from rigctl.physics.families import find_family
from rigctl.physics.interpolation import Curve
from rigctl.physics.scope import Scope

FAMILY = find_family("hydraulic_cylinder")
POINTS = [(-300.0, -90.0), (-100.0, -60.0), (-20.0, -40.0), (0.0, 0.0), (20.0, 40.0), (100.0, 60.0)]


def text(
    points: list[tuple[float, float]] = POINTS, more: str = "", slot: str = "friction", unit: str = "N"
) -> str:
    return (
        f"effect: mine\nsummary: As measured.\nslot: {slot}\n"
        f"curve:\n  of: velocity\n  over: mm/s\n  unit: {unit}\n"
        f"  points: {[list(point) for point in points]}\n{more}"
    )


def at(effect: Effect, velocity: float, **own: float) -> float:
    """The effect's share at its slot, in plain numbers."""
    (slot,) = effect.slots
    known = {p.name: p.value for p in FAMILY.parameters} | {s.name: s.start for s in FAMILY.states}
    values = {qualified(effect.name, name): value for name, value in (effect.start | own).items()}
    scope = Scope(FAMILY, {**known, **values, "velocity": velocity}, additions=effect.additions())
    return float((scope.total if FAMILY.slot(slot).combine == "sum" else scope.factor)(slot))


def drawn(points: list[tuple[float, float]]) -> Curve:
    x, y = zip(*points, strict=True)
    return Curve("curve", "1", "1", x, y, beyond="level")


def test_a_curve_file_is_read_as_a_monotone_cubic_in_its_units() -> None:
    x, y = (np.array(one) for one in zip(*POINTS, strict=True))
    effect = parse_effect(text())
    for where in (-250.0, -7.0, 0.5, 99.0):
        assert at(effect, 1e-3 * where) == pytest.approx(float(PchipInterpolator(x, y)(where)), rel=1e-6)


@st.composite
def curves(draw: st.DrawFn) -> list[tuple[float, float]]:
    steps = draw(st.lists(st.floats(1.0, 100.0), min_size=1, max_size=12))
    x = np.cumsum([draw(st.floats(-500.0, 500.0)), *steps]).tolist()
    return [(one, round(draw(st.floats(-100.0, 100.0)), 3)) for one in x]


@given(curves(), st.floats(0.0, 1.0))
def test_between_its_points_a_curve_is_a_monotone_cubic(
    points: list[tuple[float, float]], place: float
) -> None:
    x, y = (np.array(one) for one in zip(*points, strict=True))
    where = x[0] + place * (x[-1] - x[0])
    expected = float(PchipInterpolator(x, y)(where))
    assert drawn(points)(Scope(FAMILY, {}), where) == pytest.approx(expected, rel=1e-6, abs=1e-4)


@given(curves(), st.floats(0.0, 1e4))
def test_beyond_its_ends_a_curve_levels_off(points: list[tuple[float, float]], beyond: float) -> None:
    x, y = (np.array(one) for one in zip(*points, strict=True))
    curve = drawn(points)
    slopes = PchipInterpolator(x, y).derivative()
    for end, sign, interval in ((0, -1.0, x[1] - x[0]), (-1, 1.0, x[-1] - x[-2])):
        moved = float(curve(Scope(FAMILY, {}), x[end] + sign * beyond)) - y[end]
        furthest = sign * float(slopes(x[end])) * 0.5 * interval
        assert moved == pytest.approx(furthest * np.tanh(2.0 * beyond / interval), rel=1e-6, abs=1e-4)


def test_linear_extrapolation_is_optional() -> None:
    effect = parse_effect(text([(0.0, 0.0), (100.0, 50.0)], "  beyond: line\n"))
    assert at(effect, 1.0) == pytest.approx(500.0)
    assert at(effect, -1.0) == pytest.approx(-500.0)


def test_the_factor_scales_a_curve_and_the_shift_moves_it_within_its_band() -> None:
    band = f"  band: {[[y - 0.1 * abs(x), y + 0.1 * abs(x)] for x, y in POINTS]}\n"
    effect = parse_effect(text(more=band))
    assert effect.null == {"factor": 0.0, "shift": 0.0}
    assert at(effect, -0.1, factor=0.0) == 0.0
    assert at(effect, -0.1, factor=2.0) == pytest.approx(-120.0)
    assert at(effect, -0.1, shift=1.0) == pytest.approx(-50.0)
    assert at(effect, -0.1, shift=-1.0) == pytest.approx(-70.0)
    assert [one.name for one in parse_effect(text()).parameters] == ["factor"]


def test_at_a_multiplying_slot_the_curve_is_the_factor() -> None:
    effect = parse_effect(text([(-300.0, 1.0), (0.0, 1.0), (300.0, 0.5)], slot="throttle_area", unit="1"))
    assert at(effect, 0.3) == pytest.approx(0.5)
    assert at(effect, 0.3, factor=0.5) == pytest.approx(0.75)
    assert at(effect, 0.3, factor=0.0) == 1.0


def test_the_range_of_a_curve_is_its_validity_and_its_variable_its_driver() -> None:
    effect = parse_effect(text())
    assert [str(one) for one in effect.valid] == ["velocity from -300 mm/s to 100 mm/s"]
    assert [one.name for one in drivers(effect)] == ["velocity"]
    stated = parse_effect(text(more="valid: {velocity: [-200 mm/s, 50 mm/s]}\n"))
    assert [str(one) for one in stated.valid] == ["velocity from -200 mm/s to 50 mm/s"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("of: velocity", "of: velocty", "5:7: unknown name, got 'velocty'; did you mean 'velocity'"),
        ("over: mm/s", "over: mm", "the points of the curve have another unit than velocity, got 'mm'"),
        ("unit: N", "unit: bar", "another unit than the slot friction, got 'bar'; expected a force"),
        ("[-20.0, -40.0], ", "[900.0, -40.0], ", "must have rising x"),
        ("slot: friction\n", "", "the field 'slot' is missing"),
        ("slot: friction", "slot: fricton", "did you mean 'friction'"),
        ("curve:", "term: velocity\ncurve:", "an effect with a curve has no 'term'"),
        (
            "curve:",
            "parameters: {a: {start: 1, null_value: 0, bounds: [0, 2]}}\ncurve:",
            "has no 'parameters'",
        ),
        (str([list(point) for point in POINTS]), "[[0, 0], [1, 0]]", "the curve is 0 everywhere"),
        (
            "  over",
            "  band: [[0, 1]]\n  over",
            "another number of points than the curve, got '1'; expected 6",
        ),
        ("  over", f"  band: {[[1.0, 2.0]] * 6}\n  over", "the band at -300 mm/s does not hold the curve"),
    ],
)
def test_mistakes_in_a_curve_are_refused_with_a_clear_message(old: str, new: str, said: str) -> None:
    with pytest.raises(RigctlError) as caught:
        parse_effect(text().replace(old, new), Path("mine.yaml"))
    assert said in str(caught.value)


def test_compare_reports_the_uncertainty_from_the_band_of_a_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tank that drains through a hole whose law is a curve: level h, dh/dt = (inflow − curve(h))/area."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.yaml").write_text(
        "family: tank\ngeneric_effects: false\n"
        "states: {level: {start: 0.4 m, scale: 1 mm, rate: (inflow - outflow)/area}}\n"
        "inputs: {inflow: {value: 0 l/min}}\n"
        "parameters: {area: {value: 0.1 m^2, bounds: [0.01 m^2, 1 m^2]}}\n"
        "slots: {outflow: {unit: m^3/s, meaning: through the hole}}\n"
        "outputs: {level: {unit: m, formula: level}}\n"
    )
    (tmp_path / "rig.yaml").write_text(
        "name: tank\nmodel: tank.yaml\nchannels: {level: {unit: mm, quantity: other, noise: 1 mm}}\n"
        "actuators: {inflow: {kind: level, unit: l/min, low: 0 l/min, high: 20 l/min}}\n"
        "safe_state: {inflow: 0 l/min}\n"
    )
    (tmp_path / "hole.yaml").write_text(
        "effect: hole\nfamily: tank.yaml\nsummary: As measured.\nslot: outflow\n"
        "curve: {of: level, over: mm, unit: l/min, points: [[100, 3], [200, 4.2], [400, 6]], "
        "band: [[2.9, 3.1], [4.1, 4.3], [5.9, 6.1]]}\nprovenance: {date: 2026-11-22, tier: curve}\n"
    )
    (tmp_path / "model.yaml").write_text(
        "model: tank.yaml\nrig: rig.yaml\nown_effects: [hole.yaml]\n"
        "parameters: {area: {value: 0.1 m^2, fit: true}}\neffects: {hole: {factor: 1}}\n"
    )
    rng = np.random.default_rng(5)
    rows = ["time [s],record,inflow [l/min],level [mm]"]
    for record, inflow in enumerate((0.0, 3.0), start=1):
        level = 400.0
        for k in range(90):
            rows.append(f"{5 * k},{record},{inflow},{level + rng.standard_normal():.3f}")
            for _ in range(10):  # 1 l/min is 1/6 mm/s on 0.1 m^2; a hole goes with the root of the level
                level += 0.5 * (inflow - 0.3 * np.sqrt(max(level, 0.0))) / 6.0
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    run = commands.answer("import", "log.csv", "--rig", "rig.yaml")["run"]
    found = commands.answer("compare", run, "--model", "model.yaml", "--no-fit", "-o", "page.html")
    (band,) = found["curve_bands"]
    assert (band["effect"], band["channel"], band["unit"]) == ("hole", "level", "mm")
    # 0.1 l/min while the level falls, less the smaller outflow at a lower level
    assert 4.0 < band["largest"] < 20.0
    (left,) = found["outside_validity"]  # the level ends below the measured range
    assert (left["over"], left["record"], left["low"]) == ("level", f"{run}/0", 100.0)
    page = Path("page.html").read_text("utf-8")
    assert "and its curve" in page
    assert "the curve hole leaves level uncertain" in page
    assert band["statement"] in commands.told("compare", run, "--model", "model.yaml", "--no-fit")
    shown = commands.told("effects", "show", "hole.yaml", "--no-picture")
    assert "factor*curve(level)" in shown
