"""Estimate the noise coefficients of one device and the Allan tables of its sessions."""

from imuloop.core.samples import Columns
from imuloop.core.segments import read_segments
from imuloop.job_log import open_log
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings

params = snakemake.params
open_log(snakemake.log[0], f"noise {params.device}")

sessions = [
    Session(name, each["kind"], Columns(each["samples"]), read_segments(each["segments"]))
    for name, each in params.sessions.items()
]
result = estimate_noise(params.device, sessions, NoiseSettings(**params.settings))
result.to_json(snakemake.output.noise)
for name, path in zip(params.sessions, snakemake.output.allan, strict=True):
    result.allan[name].to_parquet(path, index=False)
for name, path in zip(params.sessions, snakemake.output.views, strict=True):
    result.views[name].to_parquet(path, index=False)
