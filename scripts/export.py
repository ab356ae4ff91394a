"""Write one device's calibration and noise in other tools' formats."""

from pathlib import Path

from imuloop.chain import Device, export
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.exports).parent,
)
open_log(snakemake.log[0], f"export {device.name}")
export(device)
