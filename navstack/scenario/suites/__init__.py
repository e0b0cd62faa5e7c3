"""Suites of scenarios."""
