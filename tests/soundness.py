"""Faults of result files, by themselves: numbers that are none, pages that are not well formed."""

import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd

from result_files import fault

NO_NUMBER = re.compile(r"(?<![\w.-])-?(nan|inf|infinity|none|null)(?![\w-])", re.IGNORECASE)
# as in a sentence, or in an entry of a config
WORDS = re.compile(r"\bnone\b|\bNone\b|\{time: null\}")
VOID = {"meta", "br", "link", "img", "input", "hr", "wbr"}
TEXTS = {"td", "th", "text", "li", "p", "figcaption"}


def faults_of(folder):
    """Yield the faults of all files of a folder of results, each after its path."""
    for path in sorted(folder.rglob("*")):
        faults = []
        if path.suffix == ".json":
            faults = [fault(path)]
        elif path.suffix == ".parquet":
            table = pd.read_parquet(path).select_dtypes(float)
            faults = [f"{name} is not finite" for name in table if np.isinf(table[name]).any()]
        elif path.suffix == ".csv":
            cells = re.split("[,\n]", path.read_text(encoding="utf-8"))
            faults = [cell for cell in cells if NO_NUMBER.fullmatch(cell)]
        elif path.name == "report.html":
            faults = Page(path.read_text()).faults
        yield from (f"{path.name}: {line}" for line in faults if line)


class Page(HTMLParser):
    """Elements of a page with attributes and text, and faults in them and in its words."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.text, self.faults = [], [], "", []
        self.feed(text)
        self.close()
        if self.open:
            self.faults.append(f"left open: {self.open[-1]['tag']}")

    def handle_starttag(self, tag, attributes):
        self.elements.append({"tag": tag, "text": "", **dict(attributes)})
        if tag not in VOID:
            self.open.append(self.elements[-1])
        for name, value in attributes:
            if tag in ("path", "line", "circle", "rect", "text", "svg") and name != "class":
                if re.search(r"\b(nan|inf|None)\b", value or ""):
                    self.faults.append(f"{name} of {tag} is {value[:40]}")

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open.pop()["tag"] != tag:
            self.faults.append(f"</{tag}> closes nothing")

    def handle_data(self, data):
        self.text += data
        for element in self.open:
            element["text"] += data
        if self.open and self.open[-1]["tag"] in TEXTS:
            if match := NO_NUMBER.search(data := WORDS.sub("", data)):
                around = data[max(match.start() - 40, 0) : match.end() + 20]
                self.faults.append(f"no number: {' '.join(around.split())}")

    def all(self, tag):
        """Return the elements of a tag."""
        return [e for e in self.elements if e["tag"] == tag]
