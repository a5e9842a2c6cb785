"""`python -m jounce`: the command line."""

from jounce.cli import main

main()
