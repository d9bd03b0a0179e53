"""`python -m station`: the same command."""

from station.cli import main

main()
