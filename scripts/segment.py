"""Cut each session of one device into rests, motion, disturbances and gaps."""

from pathlib import Path

from imuloop.chain import Device, segment
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"segment {params.device}")

device = Device(
    params.device,
    Path(snakemake.output[0]).parents[1],
    params.kinds,
    segment=params.settings,
    log=snakemake.log[0],
    threads=snakemake.threads,
)
tell_failures(params.device, segment(device))
