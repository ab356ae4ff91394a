"""Cut one session into rests, motion, disturbances and gaps."""

from pathlib import Path

from imuloop.chain import Device, segment
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.segments).parents[1],
)
open_log(snakemake.log[0], f"segment {device.name}")
segment(device)
