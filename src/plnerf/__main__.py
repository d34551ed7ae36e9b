"""`python -m plnerf`: the command line, for programs that start modules, as torchrun does."""

from plnerf.cli.main import main

if __name__ == "__main__":
    main()
