"""`python -m rigctl` is the same as `rigctl`."""

from rigctl.cli.main import main

main()
