"""Opens pages in headless Chromium: they show, load nothing, run nothing, and read without their style.

Usage: pages.py DIR PAGE...; screenshots in three widths and without style go into DIR."""

import html.parser
import os
import re
import subprocess
import sys
import xml.etree.ElementTree

VOID = {"meta", "br", "img", "hr", "link", "input"}


class Tags(html.parser.HTMLParser):
    """Every tag is closed in its order; nothing has a handler or an address."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attributes):
        assert tag not in {"script", "iframe", "object", "link", "img", "form"}, tag
        for name, value in attributes:
            assert not name.startswith("on") and name != "src", (tag, name)
            assert "href" not in name or value.startswith(("data:image/png;base64,", "#")), (tag, name)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        last = self.open.pop()
        assert last == tag, f"<{last}> is closed by </{tag}>"


def chromium(*arguments):
    # as root it has no sandbox; it resolves no host
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               "--host-resolver-rules=MAP * ~NOTFOUND", *arguments]
    return subprocess.run(command, check=True, capture_output=True, timeout=120).stdout.decode()


def check(page, directory):
    text = open(page).read()
    tags = Tags()
    tags.feed(text)
    assert not tags.open, tags.open
    figures = re.findall(r"<svg[ >].*?</svg>", text, re.S)
    for figure in figures:
        drawn = xml.etree.ElementTree.fromstring(figure)
        assert drawn.get("aria-label") or drawn.get("aria-hidden"), figure[:200]
    stem = os.path.splitext(os.path.basename(page))[0]
    address = "file://" + os.path.abspath(page)
    for width in (420, 800, 1400):
        chromium(f"--screenshot={directory}/{stem}-{width}.png", f"--window-size={width},3000", address)
    bare = f"{directory}/{stem}-bare.html"
    open(bare, "w").write(re.sub(r"<style>.*?</style>", "", text, flags=re.S))
    chromium(f"--screenshot={directory}/{stem}-bare.png", "--window-size=1000,3000", f"file://{os.path.abspath(bare)}")
    shown = chromium("--dump-dom", address)
    assert shown.count("<svg") == text.count("<svg") and shown.count("<tr") == text.count("<tr")
    return len(figures)


directory, pages = sys.argv[1], sys.argv[2:]
os.makedirs(directory, exist_ok=True)
for page in pages:
    print(f"{page}: {check(page, directory)} figures, {os.path.getsize(page)} bytes")
