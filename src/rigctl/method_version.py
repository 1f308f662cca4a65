"""The version of the method that verdicts are reached by: kept rates and stored fits are of one version.

It is raised when code that decides changes so that a verdict, a probability or a size could come out
differently; moving or describing code does not change it. The search for formulas has a version of its own:
it starts from a verdict and cannot change one. ``tests/test_method_version.py`` fails when such code has
changed and nothing was said: ``python tools/method_version.py`` says which way to go.
"""

from __future__ import annotations

#: raised by one when a verdict may come out differently
METHOD_VERSION = 29
#: hash of the deciding code of this version, computed by ``tools/method_version.py``
FINGERPRINT = "dbb2bd79b92f"
#: raised by one when a search for formulas may find other locations or formulas
DISCOVERY_VERSION = 3
#: hash of the code of this version of the search
DISCOVERY_FINGERPRINT = "d6fbe65f1138"
