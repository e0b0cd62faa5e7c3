"""`navstack params`: effective parameters, their differences, schema, reference, migration and conversion."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.convert import convert
from navstack.cli.output import print_json, print_note, stdout
from navstack.core import InputError, OutputError, ensure_directory, write_text
from navstack.parameters import (
    as_dict,
    as_yaml,
    json_schema,
    launch_argument,
    load_configuration,
    nearest,
    packaged_sets,
    parameters_of,
    split_namespace,
    value_text,
)
from navstack.parameters import migrate as migrated
from navstack.parameters import reference as text

if TYPE_CHECKING:
    from navstack.parameters import Parameter

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Show, compare, document, migrate and convert parameters.",
)


@app.command("show")
def show(
    params: Annotated[
        list[str],
        typer.Argument(
            metavar="PARAMS.. [NAME]",
            help="Packaged set, folder, or files in loading order; a last NAME prints only the parameters with it in their name.",
            autocompletion=options.complete_params,
        ),
    ],
    set_: options.Set = [],
    distro: options.Distro = None,
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
) -> None:
    """Print the effective parameters of every component as YAML that loads back, each with its origin."""
    wanted = None if len(params) < 2 or _is_source(params[-1]) else params[-1]
    sources = params if wanted is None else params[:-1]
    configuration = load_configuration(sources, overrides=set_, distro=distro, allow_missing=allow_missing)
    found = parameters_of(configuration)
    if wanted is not None:
        found = _named(found, wanted)
    if json_:
        print_json({"parameters": as_dict(found)})
        return
    header = ("effective parameters of " + " ".join(sources), "comments: origin of each value, or `default`")
    print(as_yaml(found, header), end="")


def _is_source(text: str) -> bool:
    """True for what names parameters: a packaged set, a file or folder, an argument of a launch file."""
    path = Path(split_namespace(text)[0])
    return text in packaged_sets() or launch_argument(text) is not None or path.exists() or bool(path.suffix)


def _named(found: list[Parameter], wanted: str) -> list[Parameter]:
    """The parameters with a text in their name. Raises InputError if there are none."""
    chosen = [p for p in found if wanted.strip("/").lower() in p.name.lower()]
    if not chosen:
        raise _no_parameter(wanted, {part for p in found for part in p.name.split("/")})
    return chosen


def _no_parameter(wanted: str, known: Iterable[str]) -> InputError:
    close = nearest(wanted, known)
    hint = f"did you mean {close}?" if close else "leave the name out for all parameters"
    return InputError(
        f'"{wanted}" is no parameter set, file or folder, and in the name of no parameter; {hint}', value=wanted
    )


@app.command("diff")
def diff(
    first: Annotated[str, typer.Argument(metavar="A", help="Packaged set, folder or file.")],
    second: Annotated[str, typer.Argument(metavar="B", help="Packaged set, folder or file to compare with.")],
    defaults: Annotated[
        bool,
        typer.Option("--defaults", help="Also list the differing parameters that neither set writes."),
    ] = False,
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
) -> None:
    """Print the differences between the effective parameters of two sets, of those that at least one of them sets.

    Defaults written out, previous names and the layout of the files make no difference.
    """
    one, other = (
        {p.name: p for p in parameters_of(load_configuration([s], allow_missing=allow_missing))}
        for s in (first, second)
    )
    different = [n for n in dict.fromkeys([*one, *other]) if _differ(one.get(n), other.get(n))]
    written = [n for n in different if any(p is not None and p.origin is not None for p in (one.get(n), other.get(n)))]
    names = different if defaults else written
    if json_:
        ours, theirs = as_dict(one.values()), as_dict(other.values())
        print_json({"differences": {n: {"a": ours.get(n), "b": theirs.get(n)} for n in names}})
    else:
        _print_differences({name: (one.get(name), other.get(name)) for name in names}, len(different) - len(names))


def _print_differences(pairs: dict[str, tuple[Parameter | None, Parameter | None]], more: int) -> None:
    out = stdout()
    for name, (a, b) in pairs.items():
        out.print(f"[bold]{escape(name)}[/]")
        for style, sign, p in (("red", "-", a), ("green", "+", b)):
            if p is not None:
                origin = escape("; ".join(text for text in (p.origin_text, p.remark) if text))
                out.print(f"  [{style}]{sign} {escape(_value(p))}[/]  [dim]# {origin}[/]")
    rest = f"; {more} more of parameters that neither sets (--defaults lists them)" if more else ""
    out.print(f"{len(pairs)} difference{'' if len(pairs) == 1 else 's'}{rest}")


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
def reference(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Only this component, or the parameters with this in their name."),
    ] = None,
    out: Annotated[Path | None, options.text_file("parameters.md")] = None,
) -> None:
    """Print the parameter reference as Markdown: default, unit, range, meaning, differences from ROS."""
    _write(text() if name is None else _about(text(), name), out)


def _about(page: str, name: str) -> str:
    """The parts of the reference about a component, or the rows of parameters with a text in their name. Raises InputError."""
    wanted = name.strip("/").lower()
    sections = page.split("\n## ")[1:]
    of_component = [
        s for s in sections if wanted in s.partition("\n\n|")[0].lower().split("`") or _title_has(s, wanted)
    ]
    found = [f"## {section.strip()}" for section in of_component] or [
        made for section in sections if (made := _rows(section, wanted))
    ]
    if not found:
        known = {row.split("`")[1] for row in page.splitlines() if row.startswith("| `")}
        raise _no_parameter(name, known)
    return "\n\n".join(found) + "\n"


def _title_has(section: str, wanted: str) -> bool:
    return wanted in section.partition("\n")[0].lower().replace(":", "").split()


def _rows(section: str, wanted: str) -> str:
    """A section with only the rows of parameters that have a text in their name; empty without any."""
    lines = section.splitlines()
    rows = [line for line in lines if line.startswith("| `") and wanted in line.split("`")[1].lower()]
    head = [line for line in lines if line.startswith(("| name", "|---"))][:2]
    namespace = next((line for line in lines if line.startswith("Namespace:")), "")
    return "\n".join([f"## {lines[0]}", "", namespace, "", *head, *rows]) if rows else ""


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


app.command("convert")(convert)


def _write(text: str, out: Path | None) -> None:
    if out is None:
        print(text, end="")
        return

    ensure_directory(out.parent)
    write_text(out, text)
