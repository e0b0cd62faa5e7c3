"""The command line. Heavy modules are imported by the command that needs them."""

from navstack.cli.entry_point import main

__all__ = ["main"]
