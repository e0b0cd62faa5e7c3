"""MkDocs hook: divide `reference/parameters.md`, which `navstack params reference` writes, into one page per component.

The repository has one file, to search in and to compare with the code; the site has an overview, a list of all names and a page
for each component. Links to a section of the one file lead to its page.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markdown.extensions.toc import slugify
from mkdocs.structure.files import File, Files

SOURCE = "reference/parameters.md"
FOLDER = "reference/parameters"
GROUPS = (
    ("Robot", ("move_base", "navstack")),
    ("Costmaps", ("Costmap", "Layer")),
    ("Global planners", ("Global planner", "Smoother")),
    ("Local planners", ("Local planner", "Path handler", "Goal checker", "Progress checker")),
    ("Critics", ("Critic",)),
    ("Recovery behaviors", ("Recovery behavior",)),
    ("Docking", ("docking_server", "Dock type", "Dock detector")),
    ("Safety", ("twist_mux", "velocity_smoother", "collision")),
    ("Localization", ("amcl", "supervision", "ekf", "Localizer")),
)
"""Title of a group in the navigation, and how the titles of its components begin."""


@dataclass
class Component:
    """A page: a component and the sections of its parts."""

    title: str
    number: int = 1
    """Its number among those whose titles differ in case only: ROS 1 and Nav2 have critics of one name."""
    sections: list[str] = field(default_factory=list)

    @property
    def file(self) -> str:
        """Name of the page's file."""
        name = re.sub(r"\W+", "_", self.title.lower()).strip("_")
        return f"{name}.md" if self.number == 1 else f"{name}_{self.number}.md"

    @property
    def rows(self) -> list[str]:
        """The rows of its tables."""
        return [row for section in self.sections for row in section.splitlines() if row.startswith("| `")]

    @property
    def names(self) -> list[str]:
        """Names of its parameters."""
        return [row.split("`")[1] for row in self.rows]

    @property
    def group(self) -> str:
        """Title of its group. Raises KeyError for a component of no group."""
        for title, beginnings in GROUPS:
            if self.title.startswith(beginnings):
                return title
        raise KeyError(f'GROUPS in {Path(__file__).name} has no group for "{self.title}"')

    def page(self) -> str:
        """The Markdown of the page."""
        first, *others = self.sections
        head, _, body = first.partition("\n")
        parts = [f"# {head}\n{body}".rstrip(), *(f"## {section.strip()}" for section in others)]
        # in HTML, the style of the page applies to these tables
        text = "\n\n".join(parts)
        return f'<div class="params" markdown>\n\n{_moved(text)}\n\n</div>\n'


def _moved(text: str) -> str:
    """The text with its links to other pages as they are one folder below."""
    return re.sub(r"\]\((?!https?:|#)([\w./-]+\.md)", r"](../\1", text)


def components(text: str) -> tuple[str, list[Component]]:
    """The introduction of the one page, and the components in their order."""
    introduction, *sections = text.split("\n## ")
    found: dict[str, Component] = {}
    for section in sections:
        title = section.partition("\n")[0].strip()
        base = title.partition(":")[0].strip()
        if base.startswith("navstack/sim/"):
            base = "navstack/sim"
        if base not in found:
            found[base] = Component(base, 1 + sum(other.lower() == base.lower() for other in found))
        found[base].sections.append(section)
    return introduction, list(found.values())


def anchors(found: list[Component]) -> dict[str, str]:
    """Anchor of each section in the one page -> file of the page with the same anchor."""
    return {
        slugify(section.partition("\n")[0].replace("`", ""), "-"): component.file
        for component in found
        for section in component.sections
    }


def overview(introduction: str, found: list[Component]) -> str:
    """The page with all components."""
    lines = [introduction.strip(), "", "[All parameters by name](parameters/names.md)", ""]
    for group, _ in GROUPS:
        lines += [f"## {group}", "", "| component | parameters | namespace |", "|---|---|---|"]
        for component in (c for c in found if c.group == group):
            place = re.search(r"^Namespace: (.+?)[;.]?(?: type .*)?$", component.sections[0], re.MULTILINE)
            where = place[1].rstrip(".;") if place else ""
            lines.append(f"| [{component.title}](parameters/{component.file}) | {len(component.names)} | {where} |")
        lines.append("")
    return "\n".join(lines)


def names_page(found: list[Component]) -> str:
    """The page with all parameters by name and the components that have them."""
    where: dict[str, list[Component]] = {}
    for component in found:
        for name in dict.fromkeys(component.names):
            where.setdefault(name, []).append(component)
    lines = ["# All parameters by name", "", "| name | component |", "|---|---|"]
    for name in sorted(where, key=str.lower):
        links = ", ".join(f"[{component.title}]({component.file})" for component in where[name])
        lines.append(f"| `{name}` | {links} |")
    return "\n".join(lines) + "\n"


def _read(config: Any) -> tuple[str, list[Component]]:
    return components((Path(config["docs_dir"]) / SOURCE).read_text(encoding="utf-8"))


def on_config(config: Any) -> Any:
    """Put the pages into the navigation, in place of the one page."""
    _, found = _read(config)
    pages: list[Any] = [SOURCE, {"All parameters by name": f"{FOLDER}/names.md"}]
    for group, _ in GROUPS:
        inside = [{c.title: f"{FOLDER}/{c.file}"} for c in found if c.group == group]
        pages.append({group: inside})
    config["nav"] = _replaced(config["nav"], {"Parameters": pages})
    return config


def _replaced(nav: list[Any], section: dict[str, Any]) -> list[Any]:
    """The navigation with the section in place of the one page."""
    made: list[Any] = []
    for item in nav:
        if item == SOURCE:
            made.append(section)
        elif isinstance(item, dict):
            made.append({k: _replaced(v, section) if isinstance(v, list) else v for k, v in item.items()})
        else:
            made.append(item)
    return made


def on_files(files: Files, config: Any) -> Files:
    """Add the pages."""
    introduction, found = _read(config)
    one = files.get_file_from_path(SOURCE)
    if one is not None:
        files.remove(one)
    for name, content in _pages(introduction, found):
        files.append(File.generated(config, name, content=content))
    return files


def _pages(introduction: str, found: list[Component]) -> Iterator[tuple[str, str]]:
    yield SOURCE, overview(introduction, found)
    yield f"{FOLDER}/names.md", names_page(found)
    for component in found:
        yield f"{FOLDER}/{component.file}", component.page()


SEARCH = (
    (f"{FOLDER}/names.md", {"exclude": True}),
    (f"{FOLDER}/", {"boost": 3.0}),
    ("reference/api/", {"boost": 0.002}),
    ("concepts/plugins.md", {"boost": 4.0}),
    ("troubleshooting.md", {"boost": 2.0}),
    ("get_started.md", {"boost": 1.2}),
    ("decisions/", {"boost": 0.1}),
    ("tutorials/write_a_", {"boost": 8.0}),
)
"""What the search prefers, by the beginning of a page's name: answers before lists of names.

A word in a title counts a thousand times, and every name of the Python API is one.
"""


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead links to a section of the one page to the page of the component, and set what the search prefers."""
    del files
    for beginning, preference in SEARCH:
        if page.file.src_uri.startswith(beginning):
            page.meta.setdefault("search", preference)
            break
    if "parameters.md#" not in markdown:
        return markdown
    known = anchors(_read(config)[1])
    here = posixpath.dirname(page.file.src_uri)

    def lead(link: re.Match[str]) -> str:
        target, anchor = link[1], link[2]
        if posixpath.normpath(posixpath.join(here, target)) != SOURCE or anchor not in known:
            return link[0]
        return f"]({posixpath.relpath(f'{FOLDER}/{known[anchor]}', here or '.')}#{anchor})"

    return re.sub(r"\]\(([\w./-]*parameters\.md)#([\w-]+)\)", lead, markdown)
