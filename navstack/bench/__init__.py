"""Benchmarks: published tasks (BARN, movingai), planners, speed, parameter sets, random scenarios.

Each benchmark is a task (a callable that performs one job), a list of jobs, and tables of the results. `navstack.jobs` runs
the jobs in parallel.
"""

__all__: list[str] = []
