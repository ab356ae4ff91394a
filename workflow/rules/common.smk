"""The config, read and checked; what a rule takes from it."""

import gc
import os
import sys
from functools import cache
from math import ceil
from pathlib import Path

import yaml
from imuloop.code_digest import code_digest
from imuloop.config import fetched, is_stored, resolve, source_path
from imuloop.config_faults import as_given, config_faults
from imuloop.without_pandas import hide_pandas
from snakemake import sourcecache

hide_pandas()

# a job is one thread; those of the linear algebra library would take the other jobs' cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# hundreds of thousands of objects of the jobs stay to the end: not worth going through so often
gc.set_threshold(100_000)

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
# devices by the names of their sessions: those alike share a rule that writes into the sessions'
# folders, so that a factory's devices need one, not one each
ALIKE = {}
for name, device in DEVICES.items():
    ALIKE.setdefault(tuple(device["sessions"]), []).append(name)
# with --jobs, which is for clusters, a device is one submission; without, and where memory has no
# limit, what a job may need is not worked out: it takes a fifth of the dry run of many devices
CLUSTER = workflow.nodes is not None
GROUP = "device" if CLUSTER else None
LIMITED = CLUSTER or "mem_mb" in workflow.global_resources
CACHE = config.get("cache", "data/cache")
FETCHED = fetched(DEVICES)
# by the environment, not as a parameter: where a file came from changes nothing in it
if "mirror" in config:
    os.environ.setdefault("IMULOOP_MIRROR", config["mirror"])


onstart:
    # Snakemake limits submissions by a timer that each job starts and that starts itself again: after
    # a thousand jobs it looks a thousand times a second at all jobs that wait. Here cores are the limit
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
        workflow.scheduler.subsample = 4 * workflow.cores


wildcard_constraints:
    device="|".join(DEVICES),
    session=r"[A-Za-z][A-Za-z0-9_-]*",
    replica="|".join(REPLICAS) or "none",
    sha256=r"[0-9a-f]{64}",
    filename=r"[^/]+",


@cache
def code(script):
    """Return the digest of the code that a script reaches."""
    return code_digest(REPOSITORY / "scripts" / script)


def device_of(wildcards):
    """Return the resolved config of a job's device."""
    return DEVICES[wildcards.device]


def session_of(wildcards):
    """Return the resolved config of a job's session."""
    return DEVICES[wildcards.device]["sessions"][wildcards.session]


def source_files(wildcards):
    """Return where the files of a session lie; of a folder, the files in it count, not its time."""
    paths = [source_path(source, CACHE) for source in session_of(wildcards)["sources"].values()]
    paths = [stored(path) if is_stored(path) else path for path in paths]
    return [ancient(path) if Path(path).is_dir() else path for path in paths]


def files_inside(wildcards):
    """Return the files in a session's folder: where one changes, the folder's own time stays."""
    folders = [Path(path) for path in source_files(wildcards) if Path(path).is_dir()]
    return [str(path) for each in folders for path in sorted(each.iterdir()) if path.is_file()]


def threads_by_size(wildcards, input):
    """Return 2 for a large log, of which two parts are worked on at once, else 1."""
    sizes = [Path(path).stat().st_size for path in input if Path(path).is_file()]
    return 2 if sum(sizes) > 100e6 else 1


def gigabytes(session):
    """Return the size of a session's logs, GB; what is still to be fetched or made counts as none."""
    paths = [source_path(source, CACHE) for source in session["sources"].values()]
    remote = sum(in_storage(path).size() for path in paths if is_stored(path))
    local = [Path(path) for path in paths if not is_stored(path)]
    inside = [file for path in local for file in (path.iterdir() if path.is_dir() else [path])]
    return (remote + sum(file.stat().st_size for file in inside if file.is_file())) / 1e9


def asked(least, per_gigabyte, of=sum):
    """Return what a cluster is asked for: more for large logs and in each retry, else the least.

    The logs are all those of the device, or with ``of=max`` the largest session's.
    """
    if not LIMITED:
        return least
    return lambda wildcards, attempt: ceil(
        attempt
        * (least + per_gigabyte * of(map(gigabytes, device_of(wildcards)["sessions"].values())))
    )


def setting(key):
    """Return a function that gives one value of a job's device."""
    return lambda wildcards: device_of(wildcards)[key]


def session_files(device, folder):
    """Return kind and files of all sessions of a device by name, in its folder of results."""
    return {
        name: {
            "kind": session["kind"],
            "quality": f"{folder}/{name}/quality.json",
            "samples": f"{folder}/{name}/samples.parquet",
            "segments": f"{folder}/{name}/segments.parquet",
            "allan_raw": f"{folder}/{name}/allan_raw.parquet",
            "allan": f"{folder}/{name}/allan.parquet",
            "views": f"{folder}/{name}/views.parquet",
        }
        for name, session in DEVICES[device]["sessions"].items()
    }


def sessions(wildcards, input):
    """Return kind and files of all sessions of a job's device, where they are: a storage moves them."""
    return session_files(wildcards.device, Path(input.samples[0]).parents[1])


def each_session(column):
    """Return a function that lists one file of each session of a job's device."""
    return lambda wildcards: [
        files[column]
        for files in session_files(wildcards.device, f"results/{wildcards.device}").values()
    ]
