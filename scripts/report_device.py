"""Write one device's part of the report."""

from pathlib import Path

from imuloop.chain import Device, report_device
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"report_device {params.device}")

folder = Path(snakemake.output.section).parent
device = Device(params.device, folder, params.kinds, label=params.label, log=snakemake.log[0])
tell_failures(params.device, report_device(device))
