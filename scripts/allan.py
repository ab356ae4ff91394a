"""Write the Allan curves of one session, as logged and corrected."""

from pathlib import Path

from imuloop.chain import Device, allan
from imuloop.job_log import run_stage

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.allan).parents[1],
    log=snakemake.log[0],
)
run_stage(allan, device)
