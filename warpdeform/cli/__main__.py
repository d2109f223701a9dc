"""`python -m warpdeform.cli`: the command line without the installed script."""

from warpdeform.cli import main

main()
