"""`navstack bench`: benchmarks of the planners, the whole stack and parameter sets."""

from navstack.cli.bench.app import app

__all__ = ["app"]
