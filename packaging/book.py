#!/usr/bin/env python3
"""A preprocessor of mdBook (`book.toml`). It appends the pages of `schemas/` to the book, and makes text of links that leave
the book: the pages are written to be read in the repository, where these links lead to files."""

import json
import os.path
import pathlib
import re
import sys

root = pathlib.Path(__file__).resolve().parent.parent
if sys.argv[1:2] == ["supports"]:  # every renderer
    sys.exit(0)
_, book = json.load(sys.stdin)


def in_book(path):
    """A path below the repository as a path in the book; None: it is in no chapter."""
    directory, _, rest = path.partition("/")
    if directory == "docs":
        return rest
    return path if directory == "schemas" and path.endswith(".md") else None


def relinked(text, directory, of_book):
    """`directory`: where the page lies in the repository; `of_book`: where in the book."""

    def link(found):
        label, target, anchor = found.groups(default="")
        path = in_book(os.path.normpath(os.path.join(directory, target)))
        return label if path is None else f"[{label}]({os.path.relpath(path, of_book)}{anchor})"

    return re.sub(r"(?<!!)\[([^\]]*)\]\((?![a-z]+:)([^)#]+)(#[^)]*)?\)", link, text)


def visit(items):
    for item in items:
        chapter = item.get("Chapter") if isinstance(item, dict) else None
        if chapter:
            of_book = os.path.dirname(chapter["path"]) or "."
            chapter["content"] = relinked(chapter["content"], os.path.join("docs", of_book), of_book)
            visit(chapter["sub_items"])


items = book["items"] if "items" in book else book["sections"]
visit(items)
items.append({"PartTitle": "Files, column by column"})
for page in sorted((root / "schemas").glob("*.md")):
    text = page.read_text()
    chapter = {"name": text.splitlines()[0].removeprefix("# "), "content": relinked(text, "schemas", "schemas")}
    path = {"path": f"schemas/{page.name}", "source_path": f"../schemas/{page.name}"}
    items.append({"Chapter": chapter | path | {"number": None, "sub_items": [], "parent_names": []}})
json.dump(book, sys.stdout)
