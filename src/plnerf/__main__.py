"""`python -m plnerf`: the command line, in the form in which torchrun starts it."""

from plnerf.cli.main import main

main()
