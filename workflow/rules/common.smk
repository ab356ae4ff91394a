"""The config, read and checked; the values that rules take from it, their memory and time."""

import os
from functools import cache
from hashlib import sha256
from math import ceil
from pathlib import Path

import imuloop
import yaml
from imuloop.code_digest import code_digest
from imuloop.config import by_type, fetched, is_stored, resolve, source_path
from imuloop.core.errors import ImuloopError, nearest
from imuloop.failures import ATTEMPT, report_failed_run
from imuloop.family import LEAST
from imuloop.file_faults import SIMULATED
from imuloop.ingest.formats import unused_readers
from imuloop.log_digest import log_digests

# a job is one thread; threads of the linear algebra library would take the other jobs' cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# not the repository of a workflow that has this one as a module
REPOSITORY = Path(imuloop.__file__).parents[3]
TEMPLATES = REPOSITORY / "workflow/templates"
# sessions of each simulated device that the workflow can make
REPLICAS = {
    path.stem: list(yaml.safe_load(path.read_text())["sessions"])
    for path in sorted(REPOSITORY.glob("data/replicas/*.yaml"))
}

# by their paths from here where these are shorter
CONFIG_FILES = {min(os.path.relpath(p), str(p), key=len): p for p in workflow.configfiles}
# as the report gives it for making it again
COMMAND = f"snakemake -c2 --configfile {' '.join(CONFIG_FILES)} -- results/report.html"

# the jobs that a run submits read the config again: it has no fault then
if workflow.is_main_process:
    from imuloop.config_faults import config_faults

    mirror = os.environ.get("IMULOOP_MIRROR")
    end_with(config_faults(config, CONFIG_FILES, replicas=REPLICAS, mirror=mirror))

DEVICES = resolve(config)
# devices of each type that is compared
TYPES = {kind: names for kind, names in by_type(DEVICES).items() if len(names) >= LEAST}
ORDER = {name: number for number, name in enumerate(DEVICES)}
NAME = r"[A-Za-z][A-Za-z0-9_-]*"
CACHE = config.get("cache", "data/cache")
FETCHED = fetched(DEVICES)
# no parameter of a rule: where a file came from changes nothing in it
if mirror := os.environ.get("IMULOOP_MIRROR"):
    config["mirror"] = mirror


wildcard_constraints:
    device=NAME,
    session=NAME,
    replica="|".join(REPLICAS) or "none",
    sha256=r"[0-9a-f]{64}",
    filename=r"[^/]+",


@cache
def code(script, *packages, without=()):
    """Return the digest of the code of a stage: its script, the package of that name, and others."""
    return code_digest(REPOSITORY / "scripts" / script, *packages, without=without)


def code_of_ingest(wildcards):
    """Return the digest of the code of ingest without the readers of formats of other sessions."""
    session = session_of(wildcards)
    paths = {role: source_path(source, CACHE) for role, source in session["sources"].items()}
    unused = () if any(map(is_stored, paths.values())) else unused_readers(session, paths)
    return code("ingest.py", without=tuple(sorted(unused)))


# not empty in a run that is to write the report
ASKED = []


def ask_for_report(wildcards):
    """Return the input of the report that a failed run renews; remember that the report is asked for."""
    ASKED.append("report")
    return ATTEMPT


def templates(*names):
    """Return the digest of templates, by their names."""
    return sha256(b"".join((TEMPLATES / name).read_bytes() for name in names)).hexdigest()


def one_of(entries, name, kind):
    """Return the entry of this name; a target may name an entry that is not there."""
    if name not in entries:
        raise ImuloopError(f"there is no {kind} '{name}'{nearest(name, entries)}")
    return entries[name]


def device_of(wildcards):
    """Return the resolved config of a job's device."""
    return one_of(DEVICES, wildcards.device, "device")


def session_of(wildcards):
    """Return the resolved config of a job's session."""
    return one_of(device_of(wildcards)["sessions"], wildcards.session, "session")


def in_order(wildcards):
    """Return a job's priority: each device is finished before the next one of the config begins."""
    return -ORDER[wildcards.device]


def settings(*keys):
    """Return a function: name and settings of a job's device, kinds of its sessions or its session."""

    def of(wildcards):
        device = device_of(wildcards)
        sessions = device["sessions"]
        if hasattr(wildcards, "session"):
            sessions = {wildcards.session: session_of(wildcards)}
        kinds = {name: session["kind"] for name, session in sessions.items()}
        return {"name": wildcards.device, "kinds": kinds, **{key: device[key] for key in keys}}

    return of


def session_files(*files, prior=False):
    """Return a function: each file of all sessions of a job's device, the file of its prior if asked.

    All in one, for `unpack`: Snakemake looks at the signature of a function in each call.
    """

    def of(wildcards):
        device = device_of(wildcards)
        folders = [f"results/{wildcards.device}/{name}" for name in device["sessions"]]
        paths = {Path(file).stem: [f"{folder}/{file}" for folder in folders] for file in files}
        return paths | ({"prior": prior_file(wildcards)} if prior else {})

    return of


def source_files(wildcards):
    """Return the files of a session; of a folder those in it too: its own time does not count."""
    paths = [source_path(source, CACHE) for source in session_of(wildcards)["sources"].values()]
    log = [ancient(path) if os.path.isdir(path) else path for path in paths]
    log = [storage(path) if is_stored(path) else path for path in log]
    return {"log": log, "inside": files_inside(wildcards)}


def files_inside(wildcards):
    """Return the files in a session's folder: where one changes, the folder's own time stays."""
    sources = session_of(wildcards)["sources"].values()
    folders = [Path(s["path"]) for s in sources if os.path.isdir(s.get("path", ""))]
    return [str(path) for folder in folders for path in sorted(folder.iterdir()) if path.is_file()]


def log_of(wildcards):
    """Return the declarations of a session's log, and the SHA-256 of its files.

    A log that an older file replaced is read again. A file that the workflow makes or fetches is
    not there at first, and counts by its content or hash.
    """
    session = session_of(wildcards)
    paths = [s["path"] for s in session["sources"].values() if "path" in s]
    local = [p for p in paths if not is_stored(p) and not SIMULATED.fullmatch(os.path.normpath(p))]
    files = filter(os.path.isfile, [*local, *files_inside(wildcards)])
    return {
        "declared": {key: value for key, value in session.items() if key != "kind"},
        "sha256": log_digests([*files], ".snakemake/imuloop/logs.jsonl"),
    }


def prior_file(wildcards):
    """Return the file of the prior of a job's device, in a list; empty if it names none."""
    prior = device_of(wildcards)["prior"]
    return [prior["file"]] if prior else []


def prior_digest(wildcards):
    """Return the SHA-256 of that file: one that an older file replaced is read again."""
    return log_digests(prior_file(wildcards), ".snakemake/imuloop/logs.jsonl")


def gigabytes(session):
    """Return the size of a session's logs, GB; a file that is not here yet counts as 0."""
    paths = [Path(source_path(source, CACHE)) for source in session["sources"].values()]
    inside = [file for path in paths for file in (path.iterdir() if path.is_dir() else [path])]
    return sum(file.stat().st_size for file in inside if file.is_file()) / 1e9


def by_size(least, per_gigabyte, **per_session):
    """Return a function of the memory or time of a job, more for large logs and in each retry.

    Of memory 1.3 times the peaks that were measured, with 330 MB for the two Snakemakes of a
    submission; a session adds what its kind has.
    """

    def of(wildcards, attempt):
        sessions = device_of(wildcards)["sessions"].values()
        kinds = sum(per_session.get(session["kind"], 0) for session in sessions)
        return ceil(attempt * (least + kinds + per_gigabyte * sum(map(gigabytes, sessions))))

    return of


def share(devices):
    """Return the devices that a job of a SLURM array works on; elsewhere all of them."""
    keys = (f"SLURM_ARRAY_TASK_{key}" for key in ("MIN", "MAX", "ID"))
    first, last, task = (int(os.environ.get(key, 0)) for key in keys)
    return list(devices)[task - first :: last - first + 1]
