"""Complete one device's calibration by those of the other devices of its type."""

from pathlib import Path

from imuloop.chain import Device, family_prior
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.calibration).parent,
    log=snakemake.log[0],
)
run_stage(family_prior, device, [Path(path).parent for path in snakemake.input.others])
