"""Harmed recordings through the whole chain: whether ``make fuzz-chain`` would see a fault."""

import os
import signal
import time

import numpy as np
import pytest

from bench.fuzz.chain import recordings, run
from bench.fuzz.chain.cases import make
from bench.fuzz.chain.harm import HARMS
from bench.fuzz.chain.judge import Page
from bench.fuzz.chain.log import Log
from imuloop import chain
from imuloop.core.errors import ImuloopError


@pytest.fixture(autouse=True)
def simulated_alone(monkeypatch):
    """Take replicas alone, which need no recording of others."""
    families = tuple((f"{name}/multi_position",) for name in recordings.SIMULATED)
    monkeypatch.setattr(recordings, "FAMILIES", families)


def table(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_a_case_is_made_of_its_number_alone(tmp_path):
    made = []
    for order in ((3, 1), (1, 3)):
        for number in order:
            folder = tmp_path / f"{order[0]} {number}"
            folder.mkdir()
            made.append((number, make(number, folder).words, table(folder)))
    assert made[0] == made[3] and made[1] == made[2] and made[0][1] != made[1][1]


@pytest.mark.parametrize("harm", HARMS, ids=lambda each: each.__name__)
@pytest.mark.parametrize("n", [1, 400])
def test_a_harm_leaves_a_log(harm, n):
    rng = np.random.default_rng(n)
    units = {"acceleration": "m/s^2", "angular_rate": "rad/s"}
    log = Log(
        kind="static",
        t=np.arange(n) / 100,
        x={sensor: rng.normal(size=(n, 3)) for sensor in units},
        temperature=np.full(n, 20.0),
        count={sensor: {"scale": 0.01, "offset": 0} for sensor in units},
        written=dict(units),
        declared=dict(units),
    )
    for _ in range(5):
        with np.errstate(all="ignore"):
            assert isinstance(harm(rng, log), str)
        assert {len(values) for values in log.x.values()} == {len(log.t)}
        assert log.temperature is None or len(log.temperature) == len(log.t)


@pytest.mark.parametrize(
    ("harm", "end", "told"),
    [
        (lambda device: None, "", None),
        (lambda device: {}["a"], "", "KeyError"),
        (lambda device: np.linalg.inv(np.zeros((2, 2))), "", "LinAlgError: Singular matrix"),
        (lambda device: _foreseen(), "", None),
        (lambda device: device.file("diagnosis.json").unlink(), "", "diagnosis.json: missing"),
        (lambda device: device.file("attitude.json").write_text("NaN"), "", "NaN is no JSON"),
        (lambda device: device.file("noise.json").write_text("{}"), "", "is a required property"),
        (lambda device: device.file("section.html").write_text("<p><td>nan"), "", "left open"),
        (lambda device: os.write(2, b"Traceback (most"), "", "terminal: Traceback"),
        (lambda device: os._exit(3), "crash", "ended with 3"),
        (lambda device: os.kill(os.getpid(), signal.SIGXCPU), "crash", "more than 60 s"),
        (lambda device: time.sleep(99), "hang", "not done within 20 s"),
        (lambda device: bytearray(1 << 31), "memory", "more than 1 GB"),
    ],
)
def test_what_goes_wrong_is_seen(monkeypatch, harm, end, told):
    report = chain.report_device

    def at_the_end(device):
        failures = report(device)
        return failures + chain.attempt(device, "report_device", lambda: harm(device), instead)

    def instead(*_):
        return None

    monkeypatch.setattr(chain, "report_device", at_the_end)
    # too few to be a log: the stages have little to do
    monkeypatch.setattr("bench.fuzz.chain.cases.MOST_ROWS", 50)
    if end == "hang":
        monkeypatch.setattr(run, "LONGEST", 20)
    ((number, found, faults),) = run.fuzz([1], 1)
    assert number == 1 and end in found
    assert (told is None) == (faults == []) and (not told or told in " ".join(faults))


def _foreseen():
    raise ImuloopError("words")


def test_a_recording_that_is_not_at_hand_is_no_fault(monkeypatch, capsys):
    monkeypatch.setattr(recordings, "FAMILIES", (("xsens_mti/poses",),))
    monkeypatch.setattr(recordings, "missing", lambda device: "xsens_acc.mat is gone")
    assert list(run.fuzz([0], 1)) == [(0, "not at hand", [])]
    assert "xsens_acc.mat is gone" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<p>1 to 2<br></p><td>none</td>", []),
        ("<p>ratio 1.0 to nan</p>", ["no number: ratio 1.0 to nan"]),
        ("<td>-inf m</td>", ["no number: -inf m"]),
        ("<b><i></b>", ["</b> closes nothing", "left open: b"]),
        ('<path d="M0 nan"/>', ["d of path is M0 nan"]),
        ("<script>NaN</script>", []),
    ],
)
def test_a_page_is_judged_by_its_elements_and_words(text, told):
    assert Page(text).faults == told
