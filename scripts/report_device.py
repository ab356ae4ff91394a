"""Write one device's part of the report."""

from pathlib import Path

from imuloop.chain import Device, report_device
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.section).parent,
    log=snakemake.log[0],
)
run_stage(report_device, device)
