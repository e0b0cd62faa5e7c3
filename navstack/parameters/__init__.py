"""Robots' YAML files, read as ROS reads them, with file, line and column of every value; and what is to be said about them.

`navstack.parameters.configuration` turns them into typed parameters of everything.
"""

from navstack.parameters.findings import Finding, Location, Severity
from navstack.parameters.sources import Sources, packaged_folder, packaged_sets, read_sources
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_reader import read_yaml

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
