"""Cut one session into rests, motion, disturbances and gaps."""

from pathlib import Path

from imuloop.chain import Device, segment
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.segments).parents[1],
    log=snakemake.log[0],
)
run_stage(segment, device)
