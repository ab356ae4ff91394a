"""Compare one device's residuals with their floors; add the effects that explain them."""

from pathlib import Path

from imuloop.chain import Device, diagnose
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.diagnosis).parent,
    log=snakemake.log[0],
)
run_stage(diagnose, device)
