"""`python -m navstack` is the `navstack` command."""

from navstack.cli import main

main()
