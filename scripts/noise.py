"""Estimate the noise coefficients of one device."""

from pathlib import Path

from imuloop.chain import Device, noise
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.noise).parent,
)
open_log(snakemake.log[0], f"noise {device.name}")
noise(device)
