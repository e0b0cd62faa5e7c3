"""Write what is known of the built-in plugins without importing them: modules, ROS names, names of parameters.

    python tools/builtin_plugins.py [--check]

navstack/plugins/builtin.py comes from the decorators `@KIND.register("name", aliases=(..))` of the sources,
navstack/parameters/builtin_names.py from the parameter models. `--check` exits with 1 if one of them would change.
"""

from __future__ import annotations

import argparse
import ast
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "navstack" / "plugins" / "builtin.py"
NAMES = ROOT / "navstack" / "parameters" / "builtin_names.py"
NAMES_HEADER = '''"""Names of the parameters of the built-in plugins, to explain unused keys without importing all of them.

Written by tools/builtin_plugins.py from the parameter models; run it after a parameter is added or renamed.
"""

from typing import Final, NamedTuple


class PluginNames(NamedTuple):
    """What the YAML of one plugin may contain."""

    values: str
    """Names of its parameters, current and previous, separated by blanks."""
    others: str = ""
    """Names that are accepted without effect, and namespaces."""
    namespaces: str = ""
    """Namespaces that it shares with other planners (`NAMESPACES`)."""


BUILTIN_NAMES: Final[dict[str, dict[str, PluginNames]]] = {
'''
HEADER = '''"""Where the built-in plugins are: kind -> registered name -> module, ROS names and other aliases.

Written by tools/builtin_plugins.py from the decorators; run it after a plugin is added, moved or renamed.
"""

from typing import Final

BUILTIN: Final[dict[str, dict[str, tuple[str, ...]]]] = {
'''


def kinds() -> dict[str, str]:
    """Return the name of each registry and the kind of its plugins, in the order of the sources."""
    tree = ast.parse((TABLE.parent / "registry.py").read_text(encoding="utf-8"))
    found: dict[str, str] = {}
    for node in tree.body:
        match node:
            case ast.AnnAssign(target=ast.Name(name), value=ast.Call(func=ast.Name("Registry"), args=[kind, *_])):
                found[name] = ast.literal_eval(kind)
            case _:
                pass
    return found


def registrations() -> dict[str, dict[str, tuple[str, ...]]]:
    """Return for every kind the registered names with module and aliases."""
    found: dict[str, dict[str, tuple[str, ...]]] = {kind: {} for kind in kinds().values()}
    for path in sorted((ROOT / "navstack").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if ".register(" not in text:
            continue
        tree = ast.parse(text)
        constants = {
            t.id: n.value for n in tree.body if isinstance(n, ast.Assign) for t in n.targets if isinstance(t, ast.Name)
        } | {n.target.id: n.value for n in tree.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(tree):
            for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                match decorator:
                    case ast.Call(func=ast.Attribute(ast.Name(registry), "register"), args=[name], keywords=keywords):
                        aliases = [_text(e, constants) for k in keywords for e in getattr(k.value, "elts", ())]
                        names = found[kinds()[registry]]
                        names[_text(name, constants)] = (module.removesuffix(".__init__"), *aliases)
                    case _:
                        pass
    return found


def _text(node: ast.expr, constants: dict[str, ast.expr | None]) -> str:
    """The value of a text, or of a constant of the module."""
    if isinstance(node, ast.Name):
        node = constants[node.id] or node
    return ast.literal_eval(node)


def table() -> str:
    """Return the text of the file."""
    lines = [HEADER]
    for kind, names in registrations().items():
        lines.append(f'    "{kind}": {{\n')
        for name, values in sorted(names.items()):
            joined = ", ".join(f'"{v}"' for v in values) + ("," if len(values) == 1 else "")
            line = f'        "{name}": ({joined}),\n'
            if len(line) > 121:
                line = f'        "{name}": (\n' + "".join(f'            "{v}",\n' for v in values) + "        ),\n"
            lines.append(line)
        lines.append("    },\n")
    return "".join([*lines, "}\n"])


def names_table() -> str:
    """Return the text of the file with the names of parameters."""
    sys.path.insert(0, str(ROOT))
    from navstack.parameters.binding import is_value, iter_names
    from navstack.plugins import GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, RECOVERY_BEHAVIORS, SMOOTHERS

    lines = [NAMES_HEADER]
    for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS, SMOOTHERS, LAYERS, RECOVERY_BEHAVIORS):
        lines.append(f'    "{registry.kind}": {{\n')
        for plugin in registry:
            if plugin.origin != "navstack":
                continue
            model = plugin.cls.Params
            names = list(dict.fromkeys(iter_names(model)))
            values = [n for n in names if n not in model.NO_EFFECT and is_value(model, n)]
            others = [n for n in names if n not in values]
            shared = getattr(plugin.cls, "NAMESPACES", ())
            lines.append(f'        "{plugin.name}": PluginNames(\n')
            for word, found in (("values", values), ("others", others), ("namespaces", shared)):
                rows = textwrap.wrap(" ".join(found), 90) or [""]
                if len(rows) > 1:
                    blocks = [f'                "{row} "\n' for row in rows[:-1]] + [f'                "{rows[-1]}"\n']
                    lines += [f"            {word}=(\n", *blocks, "            ),\n"]
                elif found or word == "values":
                    lines.append(f'            {word}="{rows[0]}",\n')
            lines.append("        ),\n")
        lines.append("    },\n")
    return "".join([*lines, "}\n"])


def main() -> int:
    """Write or check the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if the table is out of date")
    check = parser.parse_args().check
    if check:  # layout does not matter
        current = ((TABLE, table()), (NAMES, names_table()))
        return int(
            any(ast.dump(ast.parse(path.read_text("utf-8"))) != ast.dump(ast.parse(text)) for path, text in current)
        )
    TABLE.write_text(table(), encoding="utf-8")
    NAMES.write_text(names_table(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
