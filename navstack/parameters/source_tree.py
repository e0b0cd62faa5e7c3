"""The tree that sources of parameters are merged into."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.tree import Space


@dataclass(slots=True)
class Sources:
    """The merged tree, the findings and the files read."""

    root: Space = field(default_factory=lambda: Space("", Location("")))
    findings: list[Finding] = field(default_factory=list[Finding])
    files: list[str] = field(default_factory=list[str])
    """Files read, as shown in messages, in order."""
    named: set[Path] = field(default_factory=set[Path])
    """Absolute paths of the files and folders that the user named."""
    arguments: dict[str, str] = field(default_factory=dict[str, str])
    """Arguments for launch files: the sources of the form `name:=value`."""

    def add_finding(
        self, severity: Severity, rule: str, at: Location, message: str, suggestion: str | None = None
    ) -> None:
        """Add a finding about a whole source."""
        self.findings.append(finding(severity, rule, at, "", message, suggestion))
