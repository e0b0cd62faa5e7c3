"""Robots' YAML files, read as ROS reads them, with file, line and column of every value; and what is to be said about them.

`navstack.configuration` turns them into typed parameters of everything.
"""

from navstack.params.findings import Finding, Location, Severity
from navstack.params.sources import Sources, packaged_folder, packaged_sets, read_sources
from navstack.params.tree import Leaf, Space
from navstack.params.yaml_reader import read_yaml

__all__ = [
    "Finding",
    "Leaf",
    "Location",
    "Severity",
    "Sources",
    "Space",
    "packaged_folder",
    "parameter_sets",
    "read_sources",
    "read_yaml",
]

parameter_sets = packaged_sets
