"""`navstack bench`: benchmarks of the planners, the whole stack and parameter sets. One module per command."""
