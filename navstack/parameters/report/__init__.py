"""Report on parameters: the effective value and origin of each, as YAML; JSON schema, reference page, migration.

- `parameters_of`: the effective parameters of a configuration; `as_yaml` and `as_dict` write them.
- `same_parameters`: whether two configurations are equal.
- `json_schema`: a schema of the YAML for editors.
- `reference`: the reference page of all parameters (docs/reference/parameters.md).
- `migrate`: the files of a robot with current parameter names.
"""

from navstack.parameters.report.document import Parameter, as_dict, as_yaml, parameters_of, same_parameters, value_text
from navstack.parameters.report.migrate import Migration, migrate
from navstack.parameters.report.reference import reference
from navstack.parameters.report.schema import json_schema

__all__ = [
    "Migration",
    "Parameter",
    "as_dict",
    "as_yaml",
    "json_schema",
    "migrate",
    "parameters_of",
    "reference",
    "same_parameters",
    "value_text",
]
