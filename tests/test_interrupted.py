"""Ctrl-C and a closed pipe: the program ends with one line or silently, whenever they come."""

import os
import subprocess
import sys

import pytest
from scipy.io import savemat

import imuloop
from ingest.logs import brief

# runs the program, and sends it Ctrl-C when it loads a module
PROGRAM = """
import os, runpy, signal, sys
when, *sys.argv = sys.argv[1:]
# a shell may have started the tests with Ctrl-C ignored
signal.signal(signal.SIGINT, signal.default_int_handler)

def interrupt():
    os.killpg(0, signal.SIGINT)

class Loading:
    def find_spec(self, name, path=None, target=None):
        if name == when:
            interrupt()
sys.meta_path.insert(0, Loading())
runpy.run_module("imuloop", run_name="__main__", alter_sys=True)
"""


def logs(folder):
    log = brief()
    log.to_csv(folder / "log.csv", index=False)
    savemat(folder / "log.mat", {name: log[name].to_numpy() for name in log})


def environment():
    library = os.path.dirname(os.path.dirname(imuloop.__file__))
    variables = {"PYTHONPATH": library, "OPENBLAS_NUM_THREADS": "1"}
    # lines are then written when the program ends
    return {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"} | variables


@pytest.mark.parametrize(
    ("command", "when"),
    [
        ("info log.csv", "numpy"),
        ("info log.mat", "scipy.io"),
        ("report log.csv -o page.html", "imuloop.report.report"),
    ],
)
def test_ctrl_c_is_one_line_and_status_130(command, when, tmp_path):
    logs(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, when, "imuloop", *command.split()],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        start_new_session=True,
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "imuloop: interrupted\n"


def test_a_closed_pipe_is_silent(tmp_path):
    logs(tmp_path)
    command = [sys.executable, "-m", "imuloop", "info", "log.csv"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0
