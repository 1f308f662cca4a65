"""The signatures of effects on the standard record: closed forms, and similar effects."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.effects import Effect, EffectParameter, find_effect, library
from rigctl.effects.user import load_effect, parse_effect
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model.effect_preview import SAME, faults_on_record, try_effect
from rigctl.model.signature import signature
from rigctl.model.similar_effects import lookalikes
from rigctl.physics.families import FAMILIES
from rigctl.rig.load import load_rig

EXAMPLE = shipped("models", "effects", "piston-leakage-eccentric.yaml")


def cylinder(name: str) -> Effect:
    return find_effect(name, "hydraulic_cylinder")


def own(term: str, slot: str = "friction", unit: str = "N") -> Effect:
    return parse_effect(
        f"effect: mine\nsummary: A test.\nslot: {slot}\nterm: {term}\n"
        f"parameters: {{size: {{null_value: 0 {unit}, start: 5 {unit}, bounds: [0 {unit}, 500 {unit}]}}}}\n"
    )


def test_a_sensor_offset_shifts_its_own_reading_only() -> None:
    seen = signature(cylinder("position_offset"))
    place = seen.output_names.index("position")
    assert seen.difference[:, place] == pytest.approx(1e-3, abs=1e-12)
    assert not np.delete(seen.difference, place, axis=1).any()
    assert seen.slopes[:, place, 0] == pytest.approx(1.0)


def test_a_valve_delay_reduces_the_stroke_by_speed_times_delay() -> None:
    seen = signature(cylinder("valve_open_delay"))
    place = seen.output_names.index("position")
    still = np.searchsorted(seen.times, 2.0)
    moving = (seen.times > 0.7) & (seen.times < 1.2)
    speed = np.polyfit(seen.times[moving], seen.without[moving, place], 1)[0]
    assert seen.difference[still, place] == pytest.approx(-speed * 20e-3, rel=2e-3)


def test_the_slopes_agree_with_finite_differences() -> None:
    effect = cylinder("coulomb_friction")
    small = Effect(
        **{**vars(effect), "parameters": (_resized(effect.parameters[0], 1.0), effect.parameters[1])}
    )
    seen = signature(small)
    scale = np.abs(seen.difference).max(axis=0)
    assert seen.slopes.shape == (*seen.difference.shape, 1)
    place = seen.output_names.index("position")
    assert np.abs(seen.slopes[:, place, 0] - seen.difference[:, place]).max() < 0.02 * scale[place]


def _resized(parameter: EffectParameter, start: float) -> EffectParameter:
    return EffectParameter(**{**vars(parameter), "start": start})


def test_removing_base_physics_has_a_signature() -> None:
    seen = signature(cylinder("spool_lag"))
    place = seen.output_names.index("position")
    assert np.abs(seen.difference[:, place]).max() == pytest.approx(7.4e-3, rel=0.1)
    assert seen.slopes.shape[2] == 0
    assert not seen.silent


@pytest.mark.parametrize("family", FAMILIES)
def test_every_effect_of_the_library_acts_on_the_standard_record(family: str) -> None:
    # a pressure-dependent viscosity acts only where a term contains the viscosity
    alone = {"hydraulic_cylinder": {"barus", "modulus_viscosity"}}.get(family, set())
    assert {name for name, effect in library(family).items() if signature(effect).silent} == alone


def test_an_effect_that_needs_another_has_a_signature_beside_it() -> None:
    leakage = cylinder("piston_leakage")
    beside = signature(cylinder("barus"), alongside=[(leakage, leakage.start)])
    assert not beside.silent
    with pytest.raises(RigctlError, match="contradict"):
        signature(load_effect(EXAMPLE), alongside=[(leakage, leakage.start)])


def test_a_rig_selects_the_readings_of_a_signature() -> None:
    rig = load_rig(shipped("rigs", "hl32-bench.yaml"))
    seen = signature(cylinder("piston_leakage"), rig)
    assert seen.output_names == ("oil_temperature", "supply_pressure", "position")


def test_an_eccentric_piston_gap_has_the_signature_of_piston_leakage() -> None:
    effect = load_effect(EXAMPLE)
    alike = lookalikes(signature(effect), effect)
    assert alike[0].name == "piston_leakage"
    assert alike[0].likeness > SAME
    assert alike[1].likeness < 0.99
    assert [each.likeness for each in alike] == sorted((each.likeness for each in alike), reverse=True)


def test_a_closing_delay_is_separable_if_everything_is_measured() -> None:
    effect = cylinder("valve_close_delay")
    assert lookalikes(signature(effect), effect)[0].likeness < SAME


def test_the_trial_of_an_effect_warns_of_flat_unseen_and_tiny_terms() -> None:
    bench = load_rig(shipped("rigs", "hl32-bench.yaml"))
    good = try_effect(load_effect(EXAMPLE), bench)
    assert faults_on_record(good.effect, bench) == ()
    assert good.warnings == ()

    flat = try_effect(own("size^2*velocity/(1 N)/(1 m/s)"))
    assert flat.seen.flat_at_null
    assert "changes nothing to first order" in flat.warnings[0]

    unseen = try_effect(own("size", "pressure_a_reading", "Pa"), bench)
    assert unseen.seen.silent
    assert unseen.warnings == ("by itself mine has no influence on anything that rig 'HL32 bench' reads",)

    tiny = try_effect(own("1e-6*size*tanh(velocity/(2 mm/s))"), bench)
    assert "less than the noise" in tiny.warnings[0]
    assert "no reading of the standard record distinguishes it from" in tiny.warnings[1]
    assert "coulomb_friction" in tiny.warnings[1]


def test_a_term_undefined_on_the_standard_record_is_reported() -> None:
    # positive at rest, negative for a fast retraction
    faults = faults_on_record(own("size*sqrt((0.05 m/s + velocity)/(1 m/s))"))
    assert [fault.part for fault in faults] == [("terms", "friction")]
    assert "the term has no value at velocity = -0." in str(faults[0].error)
