"""What a job may use: threads, and on a cluster memory and time by the size of its logs."""

from math import ceil

# with --jobs, which is for clusters, a device is one submission; without, and where memory has no
# limit, what a job may need is not worked out: it takes a fifth of the dry run of many devices
CLUSTER = workflow.nodes is not None
GROUP = "device" if CLUSTER else None
LIMITED = CLUSTER or "mem_mb" in workflow.global_resources


onstart:
    # Snakemake limits submissions by a timer that each job starts and that starts itself again: after
    # a thousand jobs it looks a thousand times a second at all jobs that wait. Here cores are the limit
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None
        workflow.scheduler.subsample = 4 * workflow.cores


@described
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


def asked(of=sum, **resources):
    """Return what a job asks a cluster for: more for large logs and in each retry; here nothing.

    Each resource is the least and what a GB is worth of all logs of the device, or with ``of=max`` of
    the largest session's.
    """

    def by_size(least, per_gigabyte):
        return lambda wildcards, attempt: ceil(
            attempt
            * (least + per_gigabyte * of(map(gigabytes, device_of(wildcards)["sessions"].values())))
        )

    return {name: by_size(*each) for name, each in resources.items()} if LIMITED else {}
