"""The devices of both configs, brought and ingested as the workflow does."""

import os
from functools import cache

import yaml

from bench.tables import REPOSITORY
from imuloop import chain
from imuloop.chain import Device
from imuloop.config import STAGES, fetched, resolve, source_path
from imuloop.core.errors import ImuloopError
from imuloop.ingest.sources import fetch

CACHE = REPOSITORY / "data/cache"
CONFIGS = "config/measured.yaml", "config.yaml"


@cache
def devices():
    """Return the resolved config of the devices that were measured, by name."""
    resolved = {}
    for path in CONFIGS:
        resolved |= resolve(yaml.safe_load((REPOSITORY / path).read_text()))
    return {name: device for name, device in resolved.items() if fetched({name: device})}


def fetch_fault(name):
    """Bring the recordings of a device; return why one is not at hand, or None."""
    try:
        for place, source in fetched({name: devices()[name]}).items():
            if not (CACHE / place).exists():
                fetch(source, CACHE / place, mirror=os.environ.get("IMULOOP_MIRROR"))
    except ImuloopError as error:
        return str(error)
    return None


def ingest_device(name, folder):
    """Ingest the sessions of a device into a folder and return the `Device`."""
    device = devices()[name]
    settings = {key: device[key] for key in ("label", "gravity", "nominal", "full_scale", *STAGES)}
    kinds = {session: declarations["kind"] for session, declarations in device["sessions"].items()}
    imu = Device(name, folder, kinds, **settings)
    for session, declarations in device["sessions"].items():
        paths = [source_path(source, CACHE) for source in declarations["sources"].values()]
        declared = {key: value for key, value in declarations.items() if key != "kind"}
        chain.ingest(imu, session, declared, paths)
    return imu
