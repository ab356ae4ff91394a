"""Calibrate one device from its six-position and its multi-position sessions."""

from pathlib import Path

from imuloop.chain import Device, calibrate
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"calibrate {params.device}")

device = Device(
    params.device,
    Path(snakemake.output.six_position).parent,
    params.kinds,
    gravity=params.gravity,
    calibrate=params.settings,
    log=snakemake.log[0],
)
tell_failures(params.device, calibrate(device))
