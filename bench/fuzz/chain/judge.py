"""One case through the chain: what came out, and what is wrong with it."""

import csv
import json
import logging
import re
import traceback
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench.result_files import SCHEMAS, fault
from imuloop import chain
from imuloop.chain import Device
from imuloop.config import resolve
from imuloop.config_faults import config_faults
from imuloop.core.errors import ImuloopError

DEVICE = "imu"
SESSION = ("quality.json samples.parquet segments.parquet allan.parquet").split()
JSON = "noise six_position multi_position calibration diagnosis attitude summary exports".split()
TABLES = "attitude poses moves views".split()
FILES = [*(f"{name}.json" for name in JSON), *(f"{name}.parquet" for name in TABLES)]
FILES += ["exports/README.txt"]
# columns in which a value may be missing
MAY_LACK = re.compile(r"temperature.*|t_logged|(gravity_norm|pose_rate|rotation)_.*")
VOID = {"meta", "br", "link", "img", "input", "hr", "wbr"}
NO_NUMBER = re.compile(r"(?<![\w.-])-?(nan|inf|infinity|none|null)(?![\w-])", re.IGNORECASE)


def judge(case, results):
    """Run the chain on a case; return how it ended and its faults, a line each.

    What the check of its config or a stage says in words, an ImuloopError, is no fault; any other
    error that a stage failed with is one, though the report is made.

    Parameters
    ----------
    case : Case
        Its logs are written.
    results : Path
        Folder for the results.
    """
    config = {"devices": {DEVICE: case.entry}}
    results.mkdir(parents=True)
    written = results / "config.yaml"
    written.write_text(json.dumps(config))
    if lines := config_faults(config, {"config.yaml": written}, SCHEMAS / "config.schema.yaml", {}):
        return "declared", [f"no line: {line!r}" for line in lines if not line.isprintable()]
    errors = run(resolve(config)[DEVICE], results)
    faults = [told(error) for error in errors if not isinstance(error, ImuloopError)]
    faults += [line for path in needed(case, results) for line in read(path, results)]
    qualities = [json.loads(path.read_text()) for path in results.glob(f"{DEVICE}/*/quality.json")]
    ends = {"failed" if "failed" in each else each["status"] for each in qualities}
    return " and ".join(sorted(ends)), list(dict.fromkeys(faults))


def told(error):
    """Return where an error comes from and what it says, on a line."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "imuloop" in f.filename]
    last = [where(f.filename, f.lineno) for f in (own[-1:] or frames[-1:])]
    return f"traceback: {' '.join(last)} {type(error).__name__}: {error}"


def where(path, line):
    """Return a place in the code."""
    return f"{'/'.join(Path(path).parts[-2:])}:{line}"


def needed(case, results):
    """Return the files that have to be there."""
    sessions = case.entry["sessions"]
    names = [*FILES, *(f"{session}/{name}" for session in sessions for name in SESSION)]
    whole = [results / name for name in ("report.html", "comparison.csv")]
    return whole + [results / DEVICE / name for name in names]


def read(path, results):
    """Yield what is wrong with a result file."""
    name = path.relative_to(results)
    if not path.is_file():
        yield f"missing: {name.name}"
    elif path.suffix == ".json":
        yield from check_json(path)
    elif path.suffix == ".parquet":
        yield from check_table(path)
    elif path.suffix == ".html":
        yield from check_page(path)
    elif path.suffix == ".csv":
        with open(path, encoding="utf-8", newline="") as file:
            cells = [cell for row in csv.reader(file) for cell in row]
        yield from (f"{name}: {cell}" for cell in cells if NO_NUMBER.fullmatch(cell))


def check_json(path):
    """Yield what is wrong with a JSON file."""
    if wrong := fault(path):
        yield f"{path.name}: {wrong[:300]}"


def check_table(path):
    """Yield the columns of a Parquet file that hold what is no number."""
    table = pq.read_table(path)
    if path.stem == "segments":
        # a gap has no mean
        table = table.filter(pc.field("n") > 0)
    for name in table.column_names:
        values = table[name].to_numpy()
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            if np.isinf(values).any() or not MAY_LACK.fullmatch(name):
                yield f"{path.name}: {name} is not finite"


class Page(HTMLParser):
    """What is wrong with the elements and words of a page."""

    def __init__(self, text):
        super().__init__()
        self.open, self.faults = [], []
        self.feed(text)
        self.close()
        if self.open:
            self.faults.append(f"left open: {self.open[-1]}")

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("path", "line", "circle", "rect", "text", "svg"):
            for name, value in attributes:
                if name in DRAWN and re.search(r"nan|inf|None", value or ""):
                    self.faults.append(f"{name} of {tag} is {value[:40]}")

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> closes nothing")

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th", "text", "li", "p", "figcaption"):
            # what the config is to say of stamps that no clock gives
            if found := NO_NUMBER.search(data := data.replace("{time: null}", "")):
                near = " ".join(data[max(found.start() - 40, 0) : found.end() + 20].split())
                if found[1] not in WORDS:
                    self.faults.append(f"no number: {near}")


DRAWN = ("d", "x", "y", "x1", "x2", "y1", "y2", "cx", "cy", "r", "width", "height", "viewBox")
# as in a sentence
WORDS = ("none", "None")


def check_page(path):
    """Yield what is wrong with an HTML file."""
    yield from (f"{path.name}: {each}" for each in dict.fromkeys(Page(path.read_text()).faults))


def run(declared, results):
    """Make the report of a device as declared; return the errors that its stages failed with."""
    caught = Caught()
    logger = logging.getLogger()
    logger.addHandler(caught)
    # as the jobs and the command do
    logging.captureWarnings(True)
    sessions = declared["sessions"]
    device = Device(
        DEVICE,
        results / DEVICE,
        {name: session.pop("kind") for name, session in sessions.items()},
        gravity=declared["gravity"],
        nominal=declared["nominal"],
    )
    for name, session in sessions.items():
        chain.ingest(device, name, session, [session["sources"]["log"]["path"]])
    chain.run(device)
    provenance = {"command": "fuzz", "commit": "not known", "config": {}}
    chain.report(
        [results / DEVICE], provenance, results / "report.html", results / "comparison.csv"
    )
    logger.removeHandler(caught)
    return caught.errors


class Caught(logging.Handler):
    """The errors that stages failed with."""

    def __init__(self):
        super().__init__(logging.ERROR)
        self.errors = []

    def emit(self, record):
        self.errors.append(record.exc_info[1])
