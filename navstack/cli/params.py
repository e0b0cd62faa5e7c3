"""`navstack params`: what a robot's parameters come to, and what may be written in them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from navstack.parameters.report import Parameter

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode="markdown", help="What parameters come to, and what may be written in them."
)

PARAMS: Any = typer.Argument(
    ..., metavar="PARAMS..", help="A packaged set, a folder, or files in the order of loading."
)
SET: Any = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter (repeat).")
DISTRO: Any = typer.Option(None, "--distro", help="noetic or indigo: which scoring scale is meant.")
ALLOW_MISSING: Any = typer.Option(False, "--allow-missing", help="Leave out layers and plugins that are not here.")
JSON: Any = typer.Option(False, "--json", help="One JSON document on stdout.")


@app.command("show")
def show(
    params: list[str] = PARAMS,
    set_: list[str] = SET,
    distro: str | None = DISTRO,
    allow_missing: bool = ALLOW_MISSING,
    json_: bool = JSON,
) -> None:
    """Every parameter of every component in use, each with the place it was written: YAML that loads back to the same."""
    from navstack.cli.output import print_json
    from navstack.parameters.configuration import load_configuration
    from navstack.parameters.report import as_dict, as_yaml, parameters_of

    configuration = load_configuration(params, overrides=set_, distro=distro, allow_missing=allow_missing)
    found = parameters_of(configuration)
    if json_:
        print_json({"parameters": as_dict(found)})
        return
    header = ("what these come to: " + " ".join(params), "behind each value where it was written, or `default`")
    print(as_yaml(found, header), end="")


@app.command("diff")
def diff(
    first: str = typer.Argument(..., metavar="A", help="A packaged set, a folder or a file."),
    second: str = typer.Argument(..., metavar="B", help="Another one."),
    allow_missing: bool = ALLOW_MISSING,
    json_: bool = JSON,
) -> None:
    """Where two configurations differ, in what they come to: defaults, former names and layouts do not count."""
    from navstack.cli.output import print_json, stdout
    from navstack.parameters.configuration import load_configuration
    from navstack.parameters.report import as_dict, parameters_of

    one, other = (
        {p.name: p for p in parameters_of(load_configuration([s], allow_missing=allow_missing))}
        for s in (first, second)
    )
    names = [n for n in dict.fromkeys([*one, *other]) if _differ(one.get(n), other.get(n))]
    if json_:
        ours, theirs = as_dict(one.values()), as_dict(other.values())
        print_json({"differences": {n: {"a": ours.get(n), "b": theirs.get(n)} for n in names}})
        return
    from rich.markup import escape

    out = stdout()
    for name in names:
        out.print(f"[bold]{escape(name)}[/]")
        for style, sign, p in (("red", "-", one.get(name)), ("green", "+", other.get(name))):
            if p is not None:
                out.print(
                    f"  [{style}]{sign} {escape(_value(p))}[/]  [dim]# {escape('; '.join(t for t in (p.told, p.remark) if t))}[/]"
                )
    out.print(f"{len(names)} difference{'' if len(names) == 1 else 's'}")


def _differ(a: Parameter | None, b: Parameter | None) -> bool:
    return a is None or b is None or a.value != b.value


def _value(p: Parameter) -> str:
    from navstack.parameters.report.document import value_text

    text = "not given" if p.value is None else value_text(p.value)
    return f"{text} {p.unit}" if p.unit and p.value is not None else text


@app.command("schema")
def schema(
    namespace: str | None = typer.Option(
        None, "--namespace", help="Of the files of one namespace: local_costmap, DWAPlannerROS.."
    ),
    out: Path | None = typer.Option(None, "--out", metavar="FILE", help="Write it there."),
) -> None:
    """JSON Schema of the YAML, for editors: names, types, ranges and meanings while typing."""
    import json

    from navstack.core.errors import InputError
    from navstack.parameters.report import json_schema

    document = json_schema()
    if namespace is not None:
        at = document
        for part in [p for p in namespace.split("/") if p]:
            below: dict[str, Any] = at.get("properties", {}).get(part, {})
            name = str(below.get("$ref", "")).rpartition("/")[2]
            if name not in document["$defs"]:
                known = ", ".join(k for k, v in at.get("properties", {}).items() if "$ref" in v or "anyOf" in v)
                raise InputError(f'there is no schema of the namespace "{namespace}"; known: {known}')
            at = document["$defs"][name]
        document = {"$schema": document["$schema"], **at, "$defs": document["$defs"]}
    _write(json.dumps(document, indent=2, ensure_ascii=False) + "\n", out)


@app.command("reference")
def reference(out: Path | None = typer.Option(None, "--out", metavar="FILE", help="Write it there.")) -> None:
    """Every parameter there is, as Markdown: default, unit, range, meaning, what ROS does otherwise."""
    from navstack.parameters.report import reference as text

    _write(text(), out)


@app.command("migrate")
def migrate(
    params: list[str] = PARAMS,
    out: Path = typer.Option(..., "--out", metavar="DIR", help="A new folder for the files."),
    set_: list[str] = SET,
    distro: str | None = DISTRO,
    allow_missing: bool = ALLOW_MISSING,
) -> None:
    """Write the same configuration with today's names; comments stay where the layout does."""
    from navstack.cli.output import print_note, stdout
    from navstack.core.errors import OutputError
    from navstack.core.files import ensure_directory, write_text
    from navstack.parameters.report import migrate as made

    migration = made(params, overrides=set_, distro=distro, allow_missing=allow_missing)
    if out.is_dir() and any(out.iterdir()):
        raise OutputError(f"{out} is not empty; name a new folder, so that nothing is overwritten")
    folder = ensure_directory(out)
    for name, text in migration.files.items():
        ensure_directory((folder / name).parent)
        write_text(folder / name, text)
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
    from navstack.core.files import ensure_directory, write_text

    ensure_directory(out.parent)
    write_text(out, text)
