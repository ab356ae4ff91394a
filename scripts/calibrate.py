"""Calibrate one device from its six-position and its multi-position sessions."""

from imuloop.calibrate.calibrate import calibrate_device
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.job_log import open_log

params = snakemake.params
open_log(snakemake.log[0], f"calibrate {params.device}")

calibrate_device(
    device=params.device,
    gravity=params.gravity,
    sessions=params.sessions,
    noise=snakemake.input.noise,
    settings=CalibrateSettings(**params.settings),
    six_path=snakemake.output.six_position,
    multi_path=snakemake.output.multi_position,
)
