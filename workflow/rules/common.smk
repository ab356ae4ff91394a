"""The config, read and checked; what a rule takes from it."""

import atexit
import gc
import os
import sys
from functools import cache
from hashlib import sha256
from inspect import signature
from pathlib import Path

import yaml
from imuloop.code_digest import code_digest
from imuloop.config import fetched, is_stored, resolve, source_path
from imuloop.config_faults import as_given, config_faults
from imuloop.core.errors import ImuloopError, nearest
from imuloop.file_faults import SIMULATED
from imuloop.without_pandas import hide_pandas
from snakemake import sourcecache

hide_pandas()

# a job is one thread; those of the linear algebra library would take the other jobs' cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# hundreds of thousands of objects of the jobs stay to the end: not worth going through so often
gc.set_threshold(100_000)
# nor when all of them end together
atexit.register(gc.freeze)

# Snakemake takes the path of its script apart three times a job, with a class made anew each time
if hasattr(sourcecache, "parse_uri"):
    sourcecache.parse_uri = cache(sourcecache.parse_uri)

REPOSITORY = Path(workflow.basedir)
TEMPLATES = REPOSITORY / "workflow/templates"
# sessions of each simulated device that the workflow can make
REPLICAS = {
    path.stem: list(yaml.safe_load(path.read_text())["sessions"])
    for path in sorted(REPOSITORY.glob("data/replicas/*.yaml"))
}

CONFIG_FILES = {as_given(path, sys.argv): path for path in workflow.configfiles}
# as the report gives it for making it again
COMMAND = f"snakemake -c2 --configfile {' '.join(CONFIG_FILES)} -- results/report.html"

# the jobs that a run submits read the config again: it has no fault then
if workflow.is_main_process:
    faults = config_faults(
        config,
        CONFIG_FILES,
        schema=REPOSITORY / "workflow/schemas/config.schema.yaml",
        replicas=REPLICAS,
        mirror=os.environ.get("IMULOOP_MIRROR"),
    )
    if faults:
        print(*faults, sep="\n", file=sys.stderr)
        sys.exit(1)

DEVICES = resolve(config)
NAME = r"[A-Za-z][A-Za-z0-9_-]*"
# pattern of the devices by the names of their sessions: those alike share a rule that writes into
# the sessions' folders, so that a factory's devices need one, not one each
ALIKE = {}
for name, device in DEVICES.items():
    ALIKE.setdefault(tuple(device["sessions"]), []).append(name)
# one that lists 200 names takes longer to fill in: not where all are alike
ALIKE = {names: "|".join(ALIKE[names]) if len(ALIKE) > 1 else NAME for names in ALIKE}
CACHE = config.get("cache", "data/cache")
FETCHED = fetched(DEVICES)
# by the environment, not as a parameter: where a file came from changes nothing in it
if "mirror" in config:
    os.environ.setdefault("IMULOOP_MIRROR", config["mirror"])


wildcard_constraints:
    device=NAME,
    session=NAME,
    replica="|".join(REPLICAS) or "none",
    sha256=r"[0-9a-f]{64}",
    filename=r"[^/]+",


@cache
def code(script):
    """Return the digest of the code that a script reaches."""
    return code_digest(REPOSITORY / "scripts" / script)


def templates(*names):
    """Return the digest of the report's templates; each job naming them all as inputs takes longer."""
    return sha256(b"".join((TEMPLATES / name).read_bytes() for name in names)).hexdigest()


def described(function):
    """Return a function that says its signature: Snakemake asks several times a job."""
    function.__signature__ = signature(function)
    return function


def one_of(known, name, kind):
    """Return what has a name; a target may name what is not there."""
    if name not in known:
        raise ImuloopError(f"there is no {kind} '{name}'{nearest(name, known)}")
    return known[name]


def device_of(wildcards):
    """Return the resolved config of a job's device."""
    return one_of(DEVICES, wildcards.device, "device")


@described
def session_of(wildcards):
    """Return the resolved config of a job's session."""
    return one_of(device_of(wildcards)["sessions"], wildcards.session, "session")


@described
def source_files(wildcards):
    """Return where the files of a session lie; of a folder, the files in it count, not its time."""
    paths = [source_path(source, CACHE) for source in session_of(wildcards)["sources"].values()]
    paths = [stored(path) if is_stored(path) else path for path in paths]
    return [ancient(path) if Path(path).is_dir() else path for path in paths]


@described
def files_inside(wildcards):
    """Return the files in a session's folder: where one changes, the folder's own time stays."""
    folders = [Path(path) for path in source_files(wildcards) if Path(path).is_dir()]
    return [str(path) for each in folders for path in sorted(each.iterdir()) if path.is_file()]


@described
def log_bytes(wildcards):
    """Return the size of a session's logs: one that an older file replaced is read again.

    What the workflow makes or fetches is not there at first, and counts by its content or hash.
    """
    sources = session_of(wildcards)["sources"].values()
    given = [s["path"] for s in sources if "path" in s and not is_stored(s["path"])]
    files = [Path(path) for path in given if not SIMULATED.fullmatch(os.path.normpath(path))]
    inside = [Path(path) for path in files_inside(wildcards)]
    return [path.stat().st_size for path in [*files, *inside] if path.is_file()]


def setting(key):
    """Return a function that gives one value of a job's device."""
    return described(lambda wildcards: device_of(wildcards)[key])


@described
def kinds(wildcards):
    """Return the kind of each session of a job's device by name."""
    return {name: session["kind"] for name, session in device_of(wildcards)["sessions"].items()}


def each_session(file):
    """Return a function that lists one file of each session of a job's device."""
    return described(
        lambda wildcards: [
            f"results/{wildcards.device}/{name}/{file}" for name in device_of(wildcards)["sessions"]
        ]
    )
