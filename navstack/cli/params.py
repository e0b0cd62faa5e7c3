"""`navstack params`: effective parameters, their differences, schema, reference and migration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.output import print_json, print_note, stdout
from navstack.core import InputError, OutputError, ensure_directory, write_text
from navstack.parameters import as_dict, as_yaml, json_schema, load_configuration, parameters_of, value_text
from navstack.parameters import migrate as migrated
from navstack.parameters import reference as text

if TYPE_CHECKING:
    from navstack.parameters import Parameter

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Show, compare, document and migrate parameters.",
)


@app.command("show")
def show(
    params: options.ParamsArgument,
    set_: options.Set = [],
    distro: options.Distro = None,
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
) -> None:
    """Print the effective parameters of every component as YAML that loads back, each with its origin."""
    configuration = load_configuration(params, overrides=set_, distro=distro, allow_missing=allow_missing)
    found = parameters_of(configuration)
    if json_:
        print_json({"parameters": as_dict(found)})
        return
    header = ("effective parameters of " + " ".join(params), "comments: origin of each value, or `default`")
    print(as_yaml(found, header), end="")


@app.command("diff")
def diff(
    first: Annotated[str, typer.Argument(metavar="A", help="Packaged set, folder or file.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Packaged set, folder or file to compare with.")],
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
) -> None:
    """Print the differences between the effective parameters of two sets.

    Defaults written out, previous names and the layout of the files make no difference.
    """
    one, other = (
        {p.name: p for p in parameters_of(load_configuration([s], allow_missing=allow_missing))}
        for s in (first, second)
    )
    names = [n for n in dict.fromkeys([*one, *other]) if _differ(one.get(n), other.get(n))]
    if json_:
        ours, theirs = as_dict(one.values()), as_dict(other.values())
        print_json({"differences": {n: {"a": ours.get(n), "b": theirs.get(n)} for n in names}})
    else:
        _print_differences({name: (one.get(name), other.get(name)) for name in names})


def _print_differences(pairs: dict[str, tuple[Parameter | None, Parameter | None]]) -> None:
    out = stdout()
    for name, (a, b) in pairs.items():
        out.print(f"[bold]{escape(name)}[/]")
        for style, sign, p in (("red", "-", a), ("green", "+", b)):
            if p is not None:
                origin = escape("; ".join(text for text in (p.origin_text, p.remark) if text))
                out.print(f"  [{style}]{sign} {escape(_value(p))}[/]  [dim]# {origin}[/]")
    out.print(f"{len(pairs)} difference{'' if len(pairs) == 1 else 's'}")


def _differ(a: Parameter | None, b: Parameter | None) -> bool:
    return a is None or b is None or a.value != b.value


def _value(p: Parameter) -> str:
    text = "not set" if p.value is None else value_text(p.value)
    return f"{text} {p.unit}" if p.unit and p.value is not None else text


@app.command("schema")
def schema(
    namespace: Annotated[
        str | None,
        typer.Option("--namespace", metavar="NAME", help="Only this namespace: local_costmap, DWAPlannerROS, .."),
    ] = None,
    out: Annotated[Path | None, options.text_file("navstack.schema.json")] = None,
) -> None:
    """Print the JSON Schema of the YAML for editors: names, types, ranges, descriptions."""
    import json

    document = json_schema()
    if namespace is not None:
        part = _part_of_schema(document, namespace)
        document = {"$schema": document["$schema"], **part, "$defs": document["$defs"]}
    _write(json.dumps(document, indent=2, ensure_ascii=False) + "\n", out)


def _part_of_schema(document: dict[str, Any], namespace: str) -> dict[str, Any]:
    """The schema of a namespace such as local_costmap/inflation_layer. Raises InputError."""
    at = document
    for part in [p for p in namespace.split("/") if p]:
        below: dict[str, Any] = at.get("properties", {}).get(part, {})
        name = str(below.get("$ref", "")).rpartition("/")[2]
        if name not in document["$defs"]:
            known = ", ".join(k for k, v in at.get("properties", {}).items() if "$ref" in v or "anyOf" in v)
            raise InputError(f'no schema of the namespace "{namespace}"; known: {known}')
        at = document["$defs"][name]
    return at


@app.command("reference")
def reference(out: Annotated[Path | None, options.text_file("parameters.md")] = None) -> None:
    """Print the parameter reference as Markdown: default, unit, range, meaning, differences from ROS."""
    _write(text(), out)


@app.command("migrate")
def migrate(
    params: options.ParamsArgument,
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="New folder for the migrated files.", callback=options.folder_only),
    ],
    set_: options.Set = [],
    distro: options.Distro = None,
    allow_missing: options.AllowMissing = False,
) -> None:
    """Write the same configuration with current parameter names; comments are kept unless the layout changes."""
    migration = migrated(params, overrides=set_, distro=distro, allow_missing=allow_missing)
    if out.is_dir() and any(out.iterdir()):
        raise OutputError(f"--out {out} is not empty; give a new folder, so that no file is overwritten")
    folder = ensure_directory(out)
    for name, content in migration.files.items():
        ensure_directory((folder / name).parent)
        write_text(folder / name, content)
    for old, new in migration.renamed:
        stdout().print(f"{old} -> {new}")
    count = len(migration.files)
    stdout().print(f"{count} file{'' if count == 1 else 's'} in {folder}; load with --params {folder}")
    if migration.why_whole:
        print_note(f"one file without your comments: {migration.why_whole}")


def _write(text: str, out: Path | None) -> None:
    if out is None:
        print(text, end="")
        return

    ensure_directory(out.parent)
    write_text(out, text)
