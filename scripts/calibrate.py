"""Calibrate one device from its six-position and its multi-position sessions."""

from pathlib import Path

from imuloop.chain import Device, calibrate
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.six_position).parent,
)
open_log(snakemake.log[0], f"calibrate {device.name}")
calibrate(device)
