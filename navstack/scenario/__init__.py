"""Scenarios: their files, runs, success conditions, tours and suites."""
