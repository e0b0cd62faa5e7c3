"""MkDocs hook: generate the command reference from the typer application, so that it always matches `navstack --help`.

`reference/cli.md` lists the commands; each has a page of its own, with its subcommands.
"""

from __future__ import annotations

import re
from typing import Any

import typer
from mkdocs.structure.files import File, Files

PAGE = "reference/cli.md"
FOLDER = "reference/cli"
INTRODUCTION = """# Command reference

Generated from the commands. [Commands by task](commands.md) gives an overview, exit codes and file formats.

| command | what it does |
|---|---|
"""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def _default(parameter: Any) -> str:
    shown = parameter.show_default
    if isinstance(shown, str):
        return shown
    value = parameter.default
    if not shown or value is None or callable(value) or value in ((), [], False, ""):
        return ""
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def _table(context: Any, command: Any) -> str:
    rows: list[str] = []
    for parameter in command.get_params(context):
        if parameter.name == "help":
            continue
        if parameter.param_type_name == "option":
            value = "" if isinstance(parameter.default, bool) else parameter.metavar or parameter.name.upper()
            names = " ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
            names += f" {_cell(value)}" if value else ""
        else:
            names = f"`{parameter.metavar or parameter.name.upper()}`"
        rows.append(f"| {names} | {_cell(getattr(parameter, 'help', '') or '')} | {_cell(_default(parameter))} |")
    return "\n".join(["| option | meaning | default |", "|---|---|---|", *rows]) if rows else ""


def _section(path: str, context: Any, command: Any, level: int) -> str:
    text = re.sub(r"(?<!\n)\n(?!\n)", " ", (command.help or "").strip())
    usage = " ".join(command.collect_usage_pieces(context))
    parts = [f"{'#' * level} {path}", text, f"```\n{path} {usage}\n```"]
    if not getattr(command, "commands", None):
        parts.append(_table(context, command))
    for name, inner in sorted(getattr(command, "commands", {}).items()):
        inner_context = typer.Context(inner, info_name=name, parent=context)
        parts.append(_section(f"{path} {name}", inner_context, inner, min(level + 1, 4)))
    return "\n\n".join(part for part in parts if part)


def pages() -> dict[str, str]:
    """The Markdown of the command reference: page -> text."""
    from navstack.cli.app import command_tree

    tree = command_tree()
    root = typer.Context(tree, info_name="navstack")
    rows: list[str] = []
    found: dict[str, str] = {}
    for name, command in sorted(tree.commands.items()):
        context = typer.Context(command, info_name=name, parent=root)
        found[f"{FOLDER}/{name}.md"] = _section(f"navstack {name}", context, command, 1) + "\n"
        first = re.split(r"(?<=\.)\s", " ".join((command.help or "").split()), maxsplit=1)[0]
        rows.append(f"| [`navstack {name}`](cli/{name}.md) | {_cell(first)} |")
    options = f"\n\n## Options of every command\n\n{_table(root, tree)}\n"
    return {PAGE: INTRODUCTION + "\n".join(rows) + options, **found}


def on_config(config: Any) -> Any:
    """Put a page per command into the navigation."""
    for section in config["nav"]:
        for inside in section.values():
            if PAGE in inside:
                inside[inside.index(PAGE)] = {"Command reference": list(pages())}
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages to the site."""
    for name, content in pages().items():
        files.append(File.generated(config, name, content=content))
    return files
