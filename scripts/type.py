"""Look for the same formula in the devices of a type."""

from pathlib import Path

from imuloop.chain import Device, of_type
from imuloop.job_log import run_stage

folder = Path(snakemake.output.type).parent
made = Device(folder.name, folder, {}, log=snakemake.log[0])
devices = [
    Device(**each, folder=folder.parents[1] / each["name"]) for each in snakemake.params.devices
]
run_stage(of_type, made, devices)
