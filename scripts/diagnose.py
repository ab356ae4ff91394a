"""Compare one device's residuals with their floors; add the effects that explain them."""

from imuloop.calibrate.settings import CalibrateSettings
from imuloop.diagnose.diagnose import diagnose_device
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.job_log import open_log
from imuloop.noise.settings import NoiseSettings

params = snakemake.params
open_log(snakemake.log[0], f"diagnose {params.device}")

diagnose_device(
    device=params.device,
    gravity=params.gravity,
    sessions=params.sessions,
    noise=snakemake.input.noise,
    six_position=snakemake.input.six_position,
    multi_position=snakemake.input.multi_position,
    calibrate_settings=CalibrateSettings(**params.calibrate_settings),
    settings=DiagnoseSettings(**params.settings),
    noise_settings=NoiseSettings(**params.noise_settings),
    diagnosis_path=snakemake.output.diagnosis,
    calibration_path=snakemake.output.calibration,
    attitude_path=snakemake.output.attitude,
    attitude_series_path=snakemake.output.attitude_series,
)
