"""What parameters come to: every value of every component in use with its origin, and what is written from it.

`show` (YAML that loads back), `diff`, JSON Schema for editors, the reference of all parameters, today's names.
"""

from navstack.parameters.report.document import Parameter, as_dict, as_yaml, parameters_of, same_parameters
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
]
