"""Sweeps over parameters, tuning with validation on held-out scenarios, and sensitivity analysis.

`optuna`, `dask` and `ruamel.yaml` come with the extra `tune` and are imported on first use.
"""

__all__: list[str] = []
