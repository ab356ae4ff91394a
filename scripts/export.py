"""Write one device's calibration and noise in other tools' formats."""

from pathlib import Path

from imuloop.chain import Device, export
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"export {params.device}")

folder = Path(snakemake.output.exports).parent
device = Device(params.device, folder, params.kinds, label=params.label, log=snakemake.log[0])
tell_failures(params.device, export(device))
