"""Estimate the noise coefficients of one device and the Allan tables of its sessions."""

from pathlib import Path

from imuloop.chain import Device, noise
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"noise {params.device}")

device = Device(
    params.device,
    Path(snakemake.output.noise).parent,
    params.kinds,
    noise=params.settings,
    log=snakemake.log[0],
    threads=snakemake.threads,
)
tell_failures(params.device, noise(device))
