"""Tuning: sweeps over parameters, a search for better ones, and the proof that they are.

`optuna`, `dask` and `ruamel.yaml` come with the extra `tune`; nothing here imports them before it needs them.
"""
