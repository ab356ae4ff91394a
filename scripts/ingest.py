"""Bring one raw log into the canonical samples and measure its quality."""

from pathlib import Path

from imuloop.chain import Device, ingest
from imuloop.core.files import read_json
from imuloop.job_log import open_log, say

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.samples).parents[1],
)
(session,) = device.kinds
name = f"{device.name}/{session}"
open_log(snakemake.log[0], f"ingest {name}")
log, paths = snakemake.params.log["declared"], list(snakemake.input.log)
ingest(device, session, log, paths, reject=True)
quality = read_json(snakemake.output.quality)
for line in (*(f"rejected: {reason}" for reason in quality["reasons"]), *quality["warnings"]):
    say(f"{name}: {line}")
