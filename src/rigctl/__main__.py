"""`python -m rigctl` is the same as `rigctl`."""

from rigctl.child_process import leave_out_working_folder

leave_out_working_folder()

from rigctl.cli.entry import main  # noqa: E402 - with everything that it imports

main()
