"""`navstack explain`: diagnostics of runs and parameters."""

from navstack.cli.explain.app import app

__all__ = ["app"]
