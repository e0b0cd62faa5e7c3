"""Entry point of the `navstack` command."""

from __future__ import annotations

import sys


def main() -> None:
    """Runs the command line of this process and exits with its exit code."""
    from navstack.cli.app import run

    sys.exit(run(sys.argv[1:]))
