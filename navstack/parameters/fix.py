"""Correct renamed and misspelt keys in the user's own YAML files; layout and comments stay as they are.

Only keys are replaced, and only where one name is meant: a finding states it (`Finding.replacement`), and the mapping does not
have that name already. A correction that leads to an error is left out.
"""

from __future__ import annotations

import difflib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from navstack.core import atomic_write, is_file, resolved
from navstack.parameters.configuration import check_parameters
from navstack.parameters.findings import Finding
from navstack.parameters.sources import packaged_sets, split_namespace
from navstack.parameters.yaml_editor import YamlEditor
from navstack.parameters.yaml_reader import edited_files

_ROUNDS = 5
"""A corrected namespace is read, which can show further keys in it."""


@dataclass(frozen=True, slots=True)
class KeyFix:
    """A key that is replaced."""

    file: str
    line: int
    old: str
    new: str
    rule: str
    """`renamed`, `unknown` or `unknown-namespace`."""

    @property
    def text(self) -> str:
        """One line for the user."""
        kind = "renamed" if self.rule == "renamed" else "misspelt"
        return f"{self.file}:{self.line}: {self.old} -> {self.new} ({kind})"


@dataclass(frozen=True, slots=True)
class KeptKey:
    """A key that a finding reports and that stays as it is."""

    file: str
    line: int
    old: str
    reason: str


@dataclass(frozen=True, slots=True)
class KeyFixes:
    """The corrections of the files of a parameter set."""

    fixes: tuple[KeyFix, ...]
    kept: tuple[KeptKey, ...]
    texts: dict[str, tuple[str, str]]
    """File, as in findings -> text before and after."""
    findings: tuple[Finding, ...]
    """What `check_parameters` reports after the corrections."""

    def diff(self) -> str:
        """The corrections as a unified diff."""
        return "".join(
            line if line.endswith("\n") else f"{line}\n"
            for name, (before, after) in self.texts.items()
            for line in difflib.unified_diff(
                before.splitlines(keepends=True), after.splitlines(keepends=True), name, name
            )
        )

    def save(self) -> None:
        """Write the files, each atomically; links and permissions stay. Raises OutputError."""
        for name, (_, after) in self.texts.items():
            path = resolved(Path(name))
            with atomic_write(path) as beside:
                beside.write_bytes(after.encode("utf-8"))
                shutil.copymode(path, beside)


def fix_keys(
    sources: Sequence[str],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> KeyFixes:
    """Return the corrections of the keys in the files of `sources`; nothing is written before `save`."""
    fixer = _Fixer(sources)

    def check() -> list[Finding]:
        with edited_files({path: text.encode("utf-8") for path, text in fixer.edited.items()}):
            return check_parameters(sources, overrides=overrides, distro=distro, allow_missing=allow_missing)

    findings = check()
    for _ in range(_ROUNDS):
        before = _errors(findings)
        made = fixer.apply(findings)
        if not made:
            break
        findings = check()
        new = _errors(findings) - before
        if new:
            fixer.take_back(made, new)
            findings = check()
    return fixer.result(tuple(findings))


def _errors(findings: Sequence[Finding]) -> set[tuple[str, int, str, str]]:
    """File, line, name and message of the errors."""
    return {(f.file, f.line, f.key.rpartition("/")[2], f.message) for f in findings if f.severity == "error"}


class _Fixer:
    """The texts of the files with the corrections so far."""

    def __init__(self, sources: Sequence[str]) -> None:
        names = [split_namespace(source)[0] for source in sources]
        self._packaged = tuple(f"{name}/" for name in names if name in packaged_sets())
        self._before: dict[str, str] = {}
        self._texts: dict[str, str] = {}
        self._fixes: list[KeyFix] = []
        self._kept: dict[tuple[str, int, str], KeptKey] = {}

    @property
    def edited(self) -> dict[Path, str]:
        """The text of each corrected file, by its path."""
        return {resolved(Path(name)): text for name, text in self._texts.items()}

    def apply(self, findings: Sequence[Finding]) -> list[KeyFix]:
        """Correct the keys of the findings; returns what was corrected."""
        made: list[KeyFix] = []
        by_file: dict[str, list[Finding]] = {}
        for f in findings:
            if f.rule in ("renamed", "unknown", "unknown-namespace") and f.suggestion:
                by_file.setdefault(f.file, []).append(f)
        for name, found in by_file.items():
            text = self._text(name, found)
            editor = YamlEditor(text) if text is not None else None
            if editor is None:
                continue
            done = [fix for f in found if (fix := self._apply_one(editor, f)) is not None]
            if done:
                self._texts[name] = editor.text()
                made += done
        self._fixes += made
        return made

    def _text(self, name: str, found: Sequence[Finding]) -> str | None:
        """The text of a file; None for one that is not corrected, with the reason. Packaged files are never corrected."""
        if name in self._texts:
            return self._texts[name]
        reason = ""
        if name.startswith(self._packaged):
            return None
        if name.endswith((".launch", ".xml")):
            reason = "keys in a launch file are not changed; edit it"
        elif not is_file(Path(name)):
            reason = "it is not in a file"
        if not reason:
            self._before[name] = self._texts[name] = Path(name).read_bytes().decode("utf-8")
            return self._texts[name]
        for f in found:
            self._keep(f, reason)
        return None

    def _apply_one(self, editor: YamlEditor, f: Finding) -> KeyFix | None:
        if f.replacement is None:
            self._keep(
                f,
                f"{f.suggestion} is near, but not nearer than others; rename it yourself"
                if f.rule != "renamed"
                else "both names are set",
            )
            return None
        old = f.key.rpartition("/")[2]
        if any(kept == (f.file, f.line, old) for kept in self._kept):
            return None
        reason = editor.rename(f.line, f.column, old, f.replacement)
        if reason:
            self._keep(f, reason)
            return None
        return KeyFix(f.file, f.line, old, f.replacement, f.rule)

    def _keep(self, f: Finding, reason: str) -> None:
        old = f.key.rpartition("/")[2]
        self._kept.setdefault((f.file, f.line, old), KeptKey(f.file, f.line, old, reason))

    def take_back(self, made: Sequence[KeyFix], errors: set[tuple[str, int, str, str]]) -> None:
        """Undo the corrections that new errors name; all of this round if an error names none."""
        named = {(file, line, name): message for file, line, name, message in errors}
        wrong = [fix for fix in made if (fix.file, fix.line, fix.new) in named]
        if {(fix.file, fix.line, fix.new) for fix in wrong} != set(named):
            wrong = list(made)
        for fix in wrong:
            message = named.get((fix.file, fix.line, fix.new), "the parameters would have errors with it")
            self._kept[fix.file, fix.line, fix.old] = KeptKey(
                fix.file, fix.line, fix.old, f"{fix.new} would be an error: {message}"
            )
        self._fixes = [fix for fix in self._fixes if fix not in wrong]
        self._texts = dict(self._before)
        for name, text in self._before.items():
            editor = YamlEditor(text)
            for fix in self._fixes:
                if fix.file == name:
                    editor.rename(fix.line, 0, fix.old, fix.new)
            self._texts[name] = editor.text()

    def result(self, findings: tuple[Finding, ...]) -> KeyFixes:
        """The corrections, by file and line."""
        changed = {n: (self._before[n], text) for n, text in self._texts.items() if text != self._before[n]}
        fixes = sorted(self._fixes, key=lambda fix: (fix.file, fix.line))
        kept = sorted(self._kept.values(), key=lambda key: (key.file, key.line))
        return KeyFixes(tuple(fixes), tuple(kept), changed, findings)
