"""How fast several devices are switched off while one of them is dead."""
