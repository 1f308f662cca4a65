"""`python -m rigctl` is the same as `rigctl`."""

from rigctl.cli.entry import main

main()
