"""A double-acting cylinder with one rod, its valve, relief valve, pump and heated tank.

States: oil temperature, spool position, supply pressure, both chamber pressures, position, velocity.
Pressures are gauge, temperatures in K, everything in SI. There are no branches: corners are rounded by the
smooth switches of the engine, with widths that are named constants.
"""
