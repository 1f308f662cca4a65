"""The version of the method behind the verdicts, to which published rates and stored fits refer.

It is increased when the deciding code changes so that a verdict, a probability or a size may differ; moving
or documenting code does not change it. The search for formulas has a separate version, because it starts from
a verdict and cannot change it. ``tests/test_method_version.py`` fails if such code has changed without being
declared; ``python tools/method_version.py`` explains how to declare it.
"""

from __future__ import annotations

#: increased by one when a verdict may differ
METHOD_VERSION = 52
#: hash of the deciding code of this version, computed by ``tools/method_version.py``
FINGERPRINT = "49c36f0a4d1e"
#: increased by one when a search for formulas may find other locations or formulas
DISCOVERY_VERSION = 6
#: hash of the code of this version of the search
DISCOVERY_FINGERPRINT = "4a7e9c6c731d"
