"""How fast several devices are switched off while one of them is dead, and what reading them takes."""

from pathlib import Path

FOLDER = Path(__file__).parent
