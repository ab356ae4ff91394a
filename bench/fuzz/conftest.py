"""Limits of the fuzzers: what a case may take, write and start."""

import os
import resource
import signal
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

# bytes that this process may take besides what it has
MEMORY = 2 << 30
# seconds of a clock for one of processor time
WAITS = 15
# events of Python that no log may cause, and those that change the files that they name
FORBIDDEN = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.")
FORBIDDEN += ("pickle.", "ctypes.dlopen", "webbrowser.", "ftplib.", "urllib.")
CHANGES = ("os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod", "os.chown", "os.utime")
CHANGES += ("os.symlink", "os.link", "os.rename", "shutil.rmtree")
# but for the process of a reader
READER = "from imuloop.ingest.guarded import serve; serve()"


def pytest_addoption(parser):
    parser.addoption("--cases", type=int, default=50, help="of each kind of log")


def pytest_configure(config):
    settings.register_profile(
        "fuzz",
        max_examples=config.getoption("--cases"),
        deadline=None,
        database=None,
        print_blob=True,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    settings.load_profile("fuzz")


class Watch:
    """What a case does where it may not, as Python tells: an audit hook cannot be taken off."""

    def __init__(self):
        self.folder, self.outside = None, []
        sys.addaudithook(self)

    def __call__(self, event, arguments):
        if not self.folder or (event == "subprocess.Popen" and READER in arguments[1]):
            return
        if event.startswith(FORBIDDEN) and event not in CHANGES:
            self.outside.append(f"{event} {arguments}"[:300])
        writing = event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        paths = arguments[:1] if writing else arguments[:2] if event in CHANGES else ()
        # a number is a file that is open already
        for path in (os.fsdecode(each) for each in paths if isinstance(each, (str, bytes))):
            real = Path(os.path.realpath(os.path.dirname(path) or "."))
            if not real.is_relative_to(self.folder) and path != os.devnull:
                self.outside.append(f"{event} {os.path.abspath(path)}")


@pytest.fixture(scope="session")
def confined():
    """Give a context: a folder of its own, nothing anywhere else, seconds of processor time."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    watch, begun = Watch(), os.getcwd()

    def late(*_):
        raise TimeoutError("not done in time")

    for limit in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(limit, late)

    @contextmanager
    def case(seconds):
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            os.chdir(folder)
            # a reader's process has a folder of its own
            os.environ["TMPDIR"] = tempfile.tempdir = folder
            watch.folder, watch.outside = Path(os.path.realpath(folder)), []
            signal.setitimer(signal.ITIMER_PROF, seconds)
            # what waits for ever takes no processor time
            signal.alarm(WAITS * seconds)
            try:
                yield Path(folder)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
                signal.alarm(0)
                watch.folder = None
                os.chdir(begun)
                tempfile.tempdir = None
                del os.environ["TMPDIR"]
            assert not watch.outside, watch.outside

    return case
