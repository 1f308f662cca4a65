"""Parts of the base model that can be removed to show their contribution."""

from __future__ import annotations

from rigctl.effects.declaration import Effect

_FAMILY = "hydraulic_cylinder"

DENSITY_EXPANSION = Effect(
    name="density_expansion",
    family=_FAMILY,
    summary="The oil gets lighter as it warms.",
    equation="ρ = ρ15·(1 − α_v·(T − 15 degC))",
    source="practice for mineral oils, α_v = 7e-4 1/K",
    base={"thermal_expansion": 0.0},
    looks_like="Strokes grow by 1.4 % from 20 to 60 degC.",
    confused_with=("laminar_throttle", "flow_area_thermal_drift"),
    needs="records at several oil temperatures",
)

LINEAR_FRICTION = Effect(
    name="linear_friction",
    family=_FAMILY,
    summary="Friction in proportion to the speed.",
    equation="F = b·v",
    source="Merritt, Hydraulic Control Systems (1967), section 6-1",
    base={"viscous_damping": 0.0},
    looks_like="Damps the oscillation at each switch.",
    confused_with=("viscous_friction",),
)

SPOOL_LAG = Effect(
    name="spool_lag",
    family=_FAMILY,
    summary="The spool needs time to follow its solenoids.",
    equation="τ·du/dt = command − u; taken away it follows within 1 ms",
    source="Jelali & Kroll, Hydraulic Servo-systems (2003)",
    base={"spool_time": 1e-3},
    looks_like="Motion starts and ends gradually, each about τ late.",
    confused_with=("valve_open_delay", "valve_close_delay", "entrained_air"),
)

AMBIENT_LOSS = Effect(
    name="ambient_loss",
    family=_FAMILY,
    summary="The tank loses heat to the room.",
    equation="Q = UA·(T − T_amb)",
    source="Newton's law of cooling",
    base={"tank_conductance": 0.0},
    looks_like="Heating slows down as the oil warms; hot oil cools.",
    confused_with=("radiation_loss",),
    needs="heating or cooling in the data",
)

PUMP_HEATING = Effect(
    name="pump_heating",
    family=_FAMILY,
    summary="The pump's power ends as heat in the tank.",
    equation="Q = p_S·Q_pump/η_hm",
    source="energy balance; 0.5 K/min at 50 bar on the published bench",
    base={"pump_heat_share": 0.0},
    looks_like="The oil warms with the heaters off, faster at high pressure.",
    confused_with=("ambient_loss",),
    needs="minutes of running in the data",
)

EFFECTS = (DENSITY_EXPANSION, LINEAR_FRICTION, SPOOL_LAG, AMBIENT_LOSS, PUMP_HEATING)
