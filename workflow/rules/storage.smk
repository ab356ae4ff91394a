"""Logs in a storage, as s3://bucket/key: Snakemake's plugin for it, loaded only where one is used."""

from imuloop.core.errors import one_line


@cache
def lasting(kind):
    """Return the same kind of storage object, whose logs stay as they are during a run.

    At each choice of a job Snakemake asks for existence and size of what all waiting jobs need.
    """
    existence, sizes = {}, {}

    class Lasting(kind):
        def exists(self):
            if self.query not in existence:
                existence[self.query] = super().exists()
            return existence[self.query]

        def size(self):
            if self.query not in sizes:
                sizes[self.query] = super().size()
            return sizes[self.query]

    return Lasting


@cache
def stored(query):
    """Return a log in a storage as Snakemake takes it for an input."""
    log = storage(query)
    # an input is made anew for each job, of the same class
    known = log.flags["storage_object"]
    known.__class__ = lasting(type(known))
    return log


def in_storage(query):
    """Return what the plugin knows of a log in a storage."""
    return stored(query).flags["storage_object"]


def stored_size(query):
    """Return the bytes of a log in a storage."""
    return in_storage(query).size()


def storage_fault(query):
    """Return why a log in a storage cannot be had, or None."""
    try:
        found = in_storage(query)
    except Exception:
        scheme = query.partition("://")[0]
        return f"Snakemake has no plugin for {scheme}:// here; see docs/clusters.md"
    try:
        if found.exists():
            return None
    except Exception as error:
        # of the storage's own client: no credentials, no right, no answer
        return one_line(f"cannot be looked up: {error}")
    if hasattr(found, "bucket_exists") and not found.bucket_exists():
        return f"there is no bucket {found.bucket}, or it is not for these credentials to see"
    return "there is no such file in the storage"


def storage_faults():
    """Yield the faults of all logs in a storage, one line each."""
    for device, resolved in DEVICES.items():
        for session, declared in resolved["sessions"].items():
            for role, source in declared["sources"].items():
                query = source.get("path", "")
                if is_stored(query) and (fault := storage_fault(query)):
                    key = {"log": "file", "pps": "pps.file"}.get(role, f"file.{role}")
                    place = f"devices.{device}.sessions.{session}.{key}"
                    yield f"{', '.join(CONFIG_FILES)}: {place}: {query}: {fault}"


if workflow.is_main_process:
    end_with(list(storage_faults()))
