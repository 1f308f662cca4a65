"""Record-level unknowns of the heater board: the room temperature and the initial temperatures."""

from __future__ import annotations

from rigctl.effects.declaration import Effect, EffectParameter
from rigctl.effects.record_level import RECORD, Quantity, RecordLevel, Start
from rigctl.rig.rig import Rig

#: uncertainty of the recorded room temperature, K
_ROOM = 1.0


def _room(_: Rig | None) -> float:
    return _ROOM


_EFFECT = Effect(
    name=RECORD,
    family="heater_board",
    summary="Quantities that differ from record to record.",
    equation="T_room = T_ambient + d",
    source="repeated measurements at one condition",
    looks_like="Records end at other temperatures although nothing was changed.",
    terms=(("ambient", lambda m, p: p.room),),
    parameters=(EffectParameter("room", "K", 0.0, 1.0, -30.0, 30.0, "d, of the room", difference=True),),
)

RECORD_LEVEL = RecordLevel(
    effect=_EFFECT,
    quantities=(Quantity("room", "the room's temperature, less what is written down", _room),),
    starts=(Start("temperature_1", "measured"), Start("temperature_2", "measured")),
)
