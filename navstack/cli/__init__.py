"""The command line. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of the `navstack` command: runs it and exits with its code."""
    from navstack.cli.app import run

    sys.exit(run(sys.argv[1:]))
