"""The families of models shipped with rigctl, one folder each, recognised by the modules in it.

A family `X` is declared in `X/family.py` as `FAMILY`. Optionally, `X/effects/` defines its effects as
`EFFECTS`, and `X/record_level.py` defines as `RECORD_LEVEL` the quantities that differ between records.
`rigctl.physics.families` and `rigctl.effects` import from here; no other module names a family's folder.
"""

#: the order in which they are listed and searched; other families follow
FIRST = ("hydraulic_cylinder", "heater_board", "oil_viscosity")
