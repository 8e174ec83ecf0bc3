"""Links of pages that are read both in the repository and on the site."""

from __future__ import annotations

import os
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {
    ROOT / "CONTRIBUTING.md": DOCS / "repository" / "contributing.md",
    ROOT / "CHANGELOG.md": DOCS / "repository" / "changelog.md",
    ROOT / "target" / "PORTING.md": DOCS / "repository" / "porting.md",
    ROOT / "SECURITY.md": DOCS / "repository" / "security.md",
    **{
        path: DOCS / "repository" / f"{path.parent.name}.md"
        for path in (*ROOT.glob("amb_*/README.md"), *ROOT.glob("src/*/README.md"))
    },
}
"""Pages of the repository outside of `docs`, and where they are on the site."""

FRONT = {ROOT / "README.md": DOCS / "index.md"}
"""The site has a front page of its own."""

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^)\s]+)\)")
FENCE = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)


def for_site(text: str, source: Path, page: Path) -> str:
    """The text of a file with its links as they must be on a page of the site.

    A link to a file that the site does not show becomes its path.
    """

    def translate(match: re.Match[str]) -> str:
        mark, shown, target = match.groups()
        if re.match(r"[a-z]+:", target) or target.startswith("#"):
            return match[0]
        name, _, section = target.partition("#")
        place = Path(os.path.normpath(source.parent / name))
        if place in FRONT:
            section = ""
        linked = (PAGES | FRONT).get(place, place)
        if DOCS not in linked.parents:
            return (
                f"{shown} (`{place.relative_to(ROOT)}`)" if shown.strip("`") != str(place.relative_to(ROOT)) else shown
            )
        return f"{mark}[{shown}]({os.path.relpath(linked, page.parent)}{'#' if section else ''}{section})"

    parts = FENCE.split(text)
    parts[::2] = [LINK.sub(translate, part) for part in parts[::2]]
    return "".join(parts)
