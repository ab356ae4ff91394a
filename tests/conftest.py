"""Fixtures shared by all tests."""

import os
import re
import sys
import textwrap
from pathlib import Path

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

# the same examples in every run; the speed of a shared machine is not a property of the code
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# many small matrices: threads of the linear algebra library only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Python is started often, by tests and for them: it may keep byte code, as it does by default
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

REPOSITORY = Path(__file__).resolve().parents[1]
# whose tests share what takes long to make
TOGETHER = ("published", "report", "workflow")


class Together(LoadScopeScheduling):
    """Keeps on one worker what shares a fixture: a file, or one of the folders `TOGETHER`."""

    def _split_scope(self, nodeid):
        path = Path(nodeid.partition("::")[0])
        return path.parent.name if path.parent.name in TOGETHER else str(path)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    return Together(config, log)


@pytest.fixture(scope="session")
def repository():
    return REPOSITORY


class Recordings:
    """Measured recordings of others by file name; a skip says which one is missing.

    Anywhere below the folder that IMULOOP_MIRROR names, or else where a run of
    ``config/measured.yaml`` leaves the files that it fetched.
    """

    def __init__(self):
        cache = REPOSITORY / "data/cache"
        folders = (os.environ.get("IMULOOP_MIRROR"), REPOSITORY.parent / "shared/data", cache)
        self.folder = next((Path(f) for f in folders if f and Path(f).is_dir()), cache)

    def __call__(self, name):
        paths = sorted(self.folder.rglob(name))
        if not paths:
            pytest.skip(f"{name} is not at hand, docs/reproduce.md says how to get it")
        return paths[0]


@pytest.fixture(scope="session")
def recordings():
    return Recordings()


@pytest.fixture
def blank_figures(monkeypatch):
    from quick import DRAW, write_blank

    monkeypatch.setattr(DRAW, write_blank)


@pytest.fixture
def faults(tmp_path, monkeypatch):
    """Return a function: the faults of a config text, without the file's name."""
    from snakemake.common.configfile import load_configfile

    from entries import REPLICAS
    from imuloop.config_faults import config_faults

    monkeypatch.chdir(tmp_path)
    log = "t,ax,ay,az,gx,gy,gz,note\n0,0,0,9.8,0,0,0,a\n0.01,0,0,9.8,0,0,0,b\n"
    (tmp_path / "imu0").mkdir()
    for name in (
        "poses.csv",
        "counts.csv",
        "imu0/data.csv",
        "log_{x}.csv",
        " log.csv",
        "log.csv\n",
    ):
        (tmp_path / name).write_text(log)
    (tmp_path / "marks.csv").write_text("c,gnss\n1000000,5\n2000000,6\n")
    (tmp_path / "log.bag").write_text("damaged")
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    os.mkfifo(tmp_path / "pipe.csv")

    def of(text, **options):
        path = tmp_path / "config.yaml"
        path.write_text(textwrap.dedent(text))
        config = load_configfile(path)
        lines = config_faults(config, {"config.yaml": path}, REPLICAS, **options)
        assert all("\n" not in line for line in lines)
        assert all(line.startswith(("config.yaml", "IMULOOP_MIRROR")) for line in lines)
        return [re.sub(r"^config\.yaml( line \d+)?: ", "", line) for line in lines]

    return of


@pytest.fixture(scope="session")
def device(tmp_path_factory):
    """A folder with two logs of poses of a simulated device and its calibration."""
    folder = tmp_path_factory.mktemp("device")
    # loads the library
    from calibrated import calibrated_device

    calibrated_device(folder, 14, 20.0, 1, 2).to_json(folder / "calibration.json")
    return folder
