"""Compare one device's residuals with their floors; add the effects that explain them."""

from pathlib import Path

from imuloop.chain import Device, diagnose
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.diagnosis).parent,
)
open_log(snakemake.log[0], f"diagnose {device.name}")
diagnose(device)
