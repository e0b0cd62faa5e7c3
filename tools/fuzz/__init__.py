"""Seeded mutations of the files that navstack reads, and the run that reads them (`tools/fuzz_inputs.py`)."""
