"""`python -m warpdeform` is the command `warpdeform`."""

from warpdeform.cli import main

main()
