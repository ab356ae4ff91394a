"""Compare one device's residuals with their floors; add the effects that explain them."""

from pathlib import Path

from imuloop.chain import Device, diagnose
from imuloop.job_log import open_log, tell_failures

params = snakemake.params
open_log(snakemake.log[0], f"diagnose {params.device}")

device = Device(
    params.device,
    Path(snakemake.output.diagnosis).parent,
    params.kinds,
    gravity=params.gravity,
    calibrate=params.calibrate_settings,
    diagnose=params.settings,
    noise=params.noise_settings,
    log=snakemake.log[0],
)
tell_failures(params.device, diagnose(device))
