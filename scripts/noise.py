"""Estimate the noise coefficients of one device and the Allan curves of its sessions."""

from pathlib import Path

from imuloop.chain import Device, noise
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.noise).parent,
    log=snakemake.log[0],
)
run_stage(noise, device)
