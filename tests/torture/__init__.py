"""Random damage, kills and broken files: a minute of it in CI, hours by ``make torture``."""
