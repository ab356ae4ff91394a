"""Write one device's part of the report, and its calibration in other tools' formats."""

from pathlib import Path

from imuloop.chain import Device, report_device
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.section).parent,
)
open_log(snakemake.log[0], f"report_device {device.name}")
report_device(device)
