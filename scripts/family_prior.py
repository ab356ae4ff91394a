"""Complete one device's calibration by those of the other devices of its type."""

from pathlib import Path

from imuloop.chain import Device, family_prior
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.calibration).parent,
)
open_log(snakemake.log[0], f"family_prior {device.name}")
family_prior(device, [Path(path).parent for path in snakemake.input.others])
