"""Write one device's calibration and noise in other tools' formats."""

from pathlib import Path

from imuloop.chain import Device, export
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.exports).parent,
    log=snakemake.log[0],
)
run_stage(export, device)
