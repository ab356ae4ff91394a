"""Harmed recordings through the whole chain: whether ``make fuzz-chain`` would see a fault."""

import os
import signal

import pytest

import bench.fuzz.chain.__main__ as entry
from bench.fuzz.chain import recordings
from bench.fuzz.chain.cases import make
from bench.fuzz.chain.judge import Page
from imuloop import chain


@pytest.fixture(autouse=True)
def simulated_alone(monkeypatch, undrawn):
    """Take replicas alone, which need no recording of others; draw nothing."""
    families = tuple((f"{name}/multi_position",) for name in recordings.SIMULATED)
    monkeypatch.setattr(recordings, "FAMILIES", families)


def test_a_case_is_made_of_its_number_alone(tmp_path):
    made = []
    for number in (3, 1, 3):
        folder = tmp_path / str(len(made))
        folder.mkdir()
        words = make(number, folder).words
        made.append((words, {path.name: path.read_bytes() for path in folder.iterdir()}))
    assert made[0] == made[2] != made[1]


def spoil(device):
    device.file("noise.json").write_text("{}")
    device.file("section.html").write_text("<p><td>nan")


@pytest.mark.parametrize(
    ("harm", "end", "fault"),
    [
        (lambda device: None, "", None),
        (lambda device: {}["a"], "", "KeyError"),
        (spoil, "", "is a required property"),
        (lambda device: os.kill(os.getpid(), signal.SIGKILL), "crash", "ended with -9"),
    ],
)
def test_what_goes_wrong_is_seen(monkeypatch, harm, end, fault):
    report = chain.report_device

    def at_the_end(device):
        failures = report(device)
        own = chain.attempt(device, "report_device", lambda: harm(device), lambda *_: None)
        return failures + own

    monkeypatch.setattr(chain, "report_device", at_the_end)
    # too few to be a log: the stages have little to do
    monkeypatch.setattr("bench.fuzz.chain.cases.MOST_ROWS", 50)
    ((number, found, faults),) = entry.fuzz([1], 1)
    assert number == 1 and end in found
    assert faults == [] if fault is None else fault in " ".join(faults)
    assert harm is not spoil or "left open" in " ".join(faults)


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("<p>1 to 2<br></p><td>none</td>", []),
        ("<p>ratio 1.0 to nan</p>", ["no number: ratio 1.0 to nan"]),
        ("<b><i></b>", ["</b> closes nothing", "left open: b"]),
        ('<path d="M0 nan"/>', ["d of path is M0 nan"]),
        ("<script>NaN</script>", []),
    ],
)
def test_a_page_is_judged_by_its_elements_and_words(text, faults):
    assert Page(text).faults == faults
