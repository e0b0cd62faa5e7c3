"""`navstack explain`: diagnostics of runs and parameters. One module per command."""
