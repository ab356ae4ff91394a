"""Write the Allan curves of one session, as logged and corrected."""

from pathlib import Path

from imuloop.chain import Device, allan
from imuloop.job_log import open_log

device = Device(
    **snakemake.params.device,
    folder=Path(snakemake.output.allan).parents[1],
)
open_log(snakemake.log[0], f"allan {device.name}")
allan(device)
