"""Benchmarks: the whole robot against published tasks, scored by their rules. `barn` is the first."""

__all__: list[str] = []
