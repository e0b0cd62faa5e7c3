"""Scenarios by name and by number: those that come with navstack, suites for tuning, and random ones."""
