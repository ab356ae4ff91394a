"""Bring one raw log into the canonical samples and measure its quality."""

from pathlib import Path

from imuloop.chain import Device, ingest
from imuloop.core.files import read_json
from imuloop.job_log import open_log, tell, tell_failures, teller

params = snakemake.params
session = f"{params.device}/{params.session}"
open_log(snakemake.log[0], f"ingest {session}")

declared = dict(params.declared)
device = Device(
    params.device,
    Path(snakemake.output.samples).parents[1],
    {params.session: declared.pop("kind")},
    nominal=params.nominal,
    full_scale=params.full_scale,
    gravity=params.gravity,
    log=snakemake.log[0],
    threads=snakemake.threads,
)
paths = list(snakemake.input.log)
failures = ingest(device, params.session, declared, paths, teller(session))
tell_failures(params.device, failures)

if not failures:
    quality = read_json(snakemake.output.quality)
    for line in (*(f"rejected: {reason}" for reason in quality["reasons"]), *quality["warnings"]):
        tell(f"{session}: {line}")
