"""Contract of localizers: run against every registered one, including those of third parties."""

from __future__ import annotations

import pytest

from navstack.core import UnknownPluginError
from navstack.localization import Amcl
from navstack.plugins import LOCALIZERS
from navstack.testing import localizer_contract

for entry in LOCALIZERS:
    suite = localizer_contract(entry.cls)
    globals()[f"Test_{entry.name}"] = suite


def test_names_of_the_built_in_localizers() -> None:
    assert {e.name for e in LOCALIZERS if e.origin == "navstack"} == {
        "amcl",
        "dead_reckoning",
        "mapping",
        "scan_matching",
    }
    for alias in ("amcl/amcl", "nav2_amcl/AmclNode", "nav2_amcl::AmclNode"):
        assert LOCALIZERS.get(alias).cls is Amcl
    with pytest.raises(UnknownPluginError, match='did you mean "amcl"'):
        LOCALIZERS.get("amlc")
