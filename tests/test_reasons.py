"""Why nothing could be tested is said once, with the verdict: in print and on the page."""

from html.parser import HTMLParser

import numpy as np
import pytest

import imuloop
from ingest.logs import ALL, FORCE, brief


def three_faces():
    """Three rests of 8 s, with turns of 2 s between them."""
    log = brief(2800)
    log[FORCE] -= log[FORCE].mean()
    log[ALL[3:]] *= 0.05
    at = np.interp(log["t"], [0, 8, 10, 18, 20, 28], [0, 0, 1, 1, 2, 2]) * np.pi / 2
    first, second = np.minimum(at, np.pi / 2), np.maximum(at - np.pi / 2, 0)
    log["az"] += 9.80665 * np.cos(first)
    log["ax"] += 9.80665 * np.sin(first) * np.cos(second)
    log["ay"] += 9.80665 * np.sin(first) * np.sin(second)
    log["gy"] -= np.gradient(first, 0.01)
    log["gz"] -= np.gradient(second, 0.01)
    return log


class FirstLevel(HTMLParser):
    """The text of a page that is not folded."""

    def __init__(self, page):
        super().__init__()
        self.folded, self.text = 0, ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.folded += tag == "details"

    def handle_endtag(self, tag):
        self.folded -= tag == "details"

    def handle_data(self, data):
        self.text += "" if self.folded else data


def in_g():
    return brief().assign(**{name: brief()[name] / 9.80665 for name in FORCE})


REASONS = {
    "poses": (three_faces, "multi_position", "3 poses found, 12 needed"),
    "faces": (three_faces, "six_position", "3 poses found, 12 needed"),
    "a rejected log": (in_g, "multi_position", "taken as m/s^2, it looks like g"),
}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("case", REASONS)
def test_a_reason_is_said_once(case, tmp_path):
    log, kind, reason = REASONS[case]
    logs = {"t": []} | {kind.replace("multi_position", "t"): log()}
    result = imuloop.calibrate(**logs, progress=False)
    printed = " ".join(str(result).split())
    assert printed.count(reason) == 1
    assert printed.count("no static session") == 1
    page = FirstLevel(result.report(tmp_path / "page.html").read_text())
    assert page.text.count(reason) == 1
