"""The pages hang together: each is reached from docs/index.md, no link leads nowhere, what is quoted is as quoted."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?^\s*```|`[^`\n]*`", re.DOTALL | re.MULTILINE)


def links(page: Path) -> list[str]:
    """Return where a page's links lead, without those in code and those out of the repository."""
    targets = LINK.findall(CODE.sub("", page.read_text(encoding="utf-8")))
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def anchors(page: Path) -> set[str]:
    """Return the names that a page's headings get."""
    names: set[str] = set()
    text = re.sub(r"```.*?^\s*```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = re.sub(r"[^\w\- ]", "", plain).strip().replace(" ", "-")
        names.add(name if name not in names else f"{name}-1")
    return names


def dead(page: Path) -> list[str]:
    """Return a page's links that lead nowhere."""
    lost = []
    for target in links(page):
        path, _, anchor = target.partition("#")
        goal = (page.parent / path).resolve() if path else page
        if not goal.exists() or (anchor and anchor not in anchors(goal)):
            lost.append(f"{page.relative_to(ROOT)}: {target}")
    return lost


def test_no_link_leads_nowhere() -> None:
    assert [link for page in PAGES for link in dead(page)] == []


def test_a_dead_link_would_be_seen(tmp_path: Path) -> None:
    page = ROOT / "docs" / "index.md"
    assert "start" in anchors(page)
    assert LINK.findall(CODE.sub("", "[a](b.md) `[c](d.md)`\n```\n[e](f.md)\n```\n![g](h.png)")) == ["b.md", "h.png"]
    assert not (page.parent / "nowhere.md").exists()


def test_every_page_is_reached_from_the_index() -> None:
    reached = [(DOCS / target.partition("#")[0]).resolve() for target in links(DOCS / "index.md")]
    # A link to a folder leads to all that is in it.
    lonely = [
        page for page in PAGES if not any(goal == page or goal in page.parents for goal in reached if goal != ROOT)
    ]
    assert [str(page.relative_to(ROOT)) for page in lonely if page != DOCS / "index.md"] == []


def test_the_readme_leads_to_the_index() -> None:
    assert "docs/index.md" in links(ROOT / "README.md")


def test_the_readme_shows_the_script() -> None:
    body = (DOCS / "examples" / "ask_q_table.py").read_text().partition("import json")[2]
    assert body in (ROOT / "README.md").read_text()


def test_the_recipes_change_what_is_there() -> None:
    """All of it is tried in tests/system; here is noticed at once when a file moves away from under a recipe."""
    diffs = re.findall(r"In `([\w./-]+)`:\n\n```diff\n(.*?)^```$", (ROOT / "CONTRIBUTING.md").read_text(), re.S | re.M)
    assert len(diffs) >= 7
    for path, diff in diffs:
        lines = (ROOT / path).read_text().splitlines()
        assert [line for line in diff.splitlines() if line[0] in " -" and line[1:] not in lines] == [], path
