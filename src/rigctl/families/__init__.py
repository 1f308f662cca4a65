"""The families of models that come with rigctl: each is one folder, found by what stands in it.

A family `X` is declared in `X/family.py` as `FAMILY`. Where they are there, `X/effects/` offers its effects
as `EFFECTS`, and `X/record_level.py` says as `RECORD_LEVEL` what differs between its records.
`rigctl.physics.families` and `rigctl.effects` look here; no other module names a family's folder.
"""

#: in this order they are listed, and looked through where several have what is asked for; others come after
FIRST = ("hydraulic_cylinder", "heater_board", "oil_viscosity")
