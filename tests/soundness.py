"""A device through the whole chain: its results, and their faults."""

import json
import logging
import re
import traceback
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq

from imuloop import chain
from imuloop.chain import Device
from imuloop.config import resolve
from imuloop.config_faults import config_faults
from imuloop.report.report import write_report
from result_files import fault

DEVICE = "imu"
SESSION = ("quality.json samples.parquet segments.parquet allan.parquet").split()
JSON = "noise six_position multi_position calibration diagnosis attitude summary exports".split()
TABLES = "attitude poses moves spectra".split()
FILES = [*(f"{name}.json" for name in JSON), *(f"{name}.parquet" for name in TABLES)]
FILES += ["exports/README.txt"]
# columns in which a value may be missing
MAY_LACK = re.compile(r"temperature.*|t_logged|(gravity_norm|pose_rate|rotation|velocity|knock)_.*")
NO_NUMBER = re.compile(r"(?<![\w.-])-?(nan|inf|infinity|none|null)(?![\w-])", re.IGNORECASE)
# as in a sentence, or in an entry of a config
WORDS = re.compile(r"\bnone\b|\bNone\b|\{time: null\}")
VOID = {"meta", "br", "link", "img", "input", "hr", "wbr"}
TEXTS = {"td", "th", "text", "li", "p", "figcaption"}


def judge(entry, results):
    """Run the chain on a device as a config has it; return its faults, a line each.

    Messages of the config's check are not faults, nor is a rejected session; an exception of a
    stage is one.
    """
    config = {"devices": {DEVICE: entry}}
    results.mkdir(parents=True)
    written = results / "config.yaml"
    written.write_text(json.dumps(config))
    if lines := config_faults(config, {"config.yaml": written}, {}):
        return [f"no line: {line!r}" for line in lines if not line.isprintable()]
    # as the jobs do
    logging.captureWarnings(True)
    try:
        run(resolve(config)[DEVICE], results)
    except Exception as error:
        return [origin(error)]
    faults = []
    names = [
        *FILES,
        *(f"{session}/{name}" for session in entry["sessions"] for name in SESSION),
    ]
    paths = [results / "report.html", results / "comparison.csv"]
    paths += [results / DEVICE / name for name in names]
    faults += [f"{path.name}: {each}" for path in paths for each in read(path)]
    return list(dict.fromkeys(faults))


def origin(error):
    """Return the place and the text of an error, on a line."""
    frames = traceback.extract_tb(error.__traceback__)
    last = [f for f in frames if "imuloop" in f.filename][-1:] or frames[-1:]
    where = " ".join(f"{'/'.join(Path(f.filename).parts[-2:])}:{f.lineno}" for f in last)
    return f"traceback: {where} {type(error).__name__}: {error}"


def read(path):
    """Yield the faults of a result file."""
    if not path.is_file():
        yield "missing"
    elif path.suffix == ".json":
        if wrong := fault(path):
            yield wrong[:300]
    elif path.suffix == ".parquet":
        table = pq.read_table(path)
        if path.stem == "segments":
            # a gap has no mean
            table = table.filter(pc.field("n") > 0)
        for name in table.column_names:
            values = table[name].to_numpy()
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                if np.isinf(values).any() or not MAY_LACK.fullmatch(name):
                    yield f"{name} is not finite"
    elif path.suffix == ".csv":
        cells = re.split("[,\n]", path.read_text(encoding="utf-8"))
        yield from (cell for cell in cells if NO_NUMBER.fullmatch(cell))
    elif path.suffix == ".html":
        yield from dict.fromkeys(Page(path.read_text()).faults)


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
            if found := NO_NUMBER.search(data := WORDS.sub("", data)):
                around = data[max(found.start() - 40, 0) : found.end() + 20]
                self.faults.append(f"no number: {' '.join(around.split())}")

    def all(self, tag):
        """Return the elements of a tag."""
        return [e for e in self.elements if e["tag"] == tag]


def run(declared, results):
    """Make the report of a device as declared."""
    sessions = declared["sessions"]
    kinds = {name: session.pop("kind") for name, session in sessions.items()}
    given = {key: declared[key] for key in ("gravity", "nominal")}
    device = Device(DEVICE, results / DEVICE, kinds, **given)
    for name, session in sessions.items():
        paths = [session["sources"]["log"]["path"]]
        chain.ingest(device, name, session, paths, reject=True)
    chain.run(device)
    provenance = {"imuloop": "0", "command": "test", "commit": "not known", "config": {}}
    write_report(
        [results / DEVICE], provenance, results / "report.html", results / "comparison.csv"
    )
