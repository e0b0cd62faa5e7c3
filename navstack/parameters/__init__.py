"""Parameters: ROS YAML and launch files with the location of every value -> typed, checked configuration of a robot.

- `load_configuration`, `check_parameters`, `choose_global_planner`: what most callers need.
- `read_sources`, `read_yaml`, `Space`, `Leaf`: the tree of parameters before it is typed.
- `navstack.parameters.report`: effective parameters, JSON schema, reference page, migration.
"""

from navstack.parameters.configuration import (
    Configuration,
    CostmapConfiguration,
    NavstackParams,
    check_parameters,
    choose_global_planner,
    load_configuration,
)
from navstack.parameters.findings import Finding, Location, Severity
from navstack.parameters.sources import Sources, packaged_folder, packaged_sets, read_sources
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_reader import read_yaml

__all__ = [
    "Configuration",
    "CostmapConfiguration",
    "Finding",
    "Leaf",
    "Location",
    "NavstackParams",
    "Severity",
    "Sources",
    "Space",
    "check_parameters",
    "choose_global_planner",
    "load_configuration",
    "packaged_folder",
    "packaged_sets",
    "read_sources",
    "read_yaml",
]
