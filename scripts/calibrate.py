"""Calibrate one device from its six-position and its multi-position sessions."""

from pathlib import Path

from imuloop.chain import Device, calibrate
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.six_position).parent,
    log=snakemake.log[0],
)
run_stage(calibrate, device)
