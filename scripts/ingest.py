"""Bring one raw log into the canonical samples and measure its quality."""

from pathlib import Path

from imuloop.chain import Device, ingest
from imuloop.core.files import read_json
from imuloop.job_log import run_stage, say

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.samples).parents[1],
    log=snakemake.log[0],
    threads=snakemake.threads,
)
(session,) = device.kinds
name, log = f"{device.name}/{session}", list(snakemake.input.log)
if not run_stage(ingest, device, session, snakemake.params.declared, log):
    quality = read_json(snakemake.output.quality)
    for line in (*(f"rejected: {reason}" for reason in quality["reasons"]), *quality["warnings"]):
        say(f"{name}: {line}")
