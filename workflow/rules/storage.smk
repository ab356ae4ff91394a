"""Logs in a storage, as s3://bucket/key: Snakemake's plugin for it, loaded only where one is used."""

from imuloop.core.errors import one_line


@cache
def stored(query):
    """Return a log in a storage as Snakemake takes it for an input."""
    return storage(query)


def in_storage(query):
    """Return what the plugin knows of a log in a storage."""
    return stored(query).flags["storage_object"]


@cache
def stored_size(query):
    """Return the bytes of a log in a storage: asked once, each job and each retry needs them."""
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


if workflow.is_main_process and (faults := list(storage_faults())):
    raise WorkflowError("\n".join(faults))
