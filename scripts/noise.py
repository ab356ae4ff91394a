"""Estimate the noise coefficients of one device and the Allan tables of its sessions."""

from imuloop.core.samples import Columns, read_columns
from imuloop.job_log import open_log
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.noise.tables import write_table

params = snakemake.params
open_log(snakemake.log[0], f"noise {params.device}")

sessions = [
    Session(name, each["kind"], Columns(each["samples"]), read_columns(each["segments"]))
    for name, each in params.sessions.items()
]
settings = NoiseSettings(**params.settings)
result = estimate_noise(params.device, sessions, settings, threads=snakemake.threads)
result.to_json(snakemake.output.noise)
for name, path in zip(params.sessions, snakemake.output.allan, strict=True):
    write_table(path, result.allan[name])
for name, path in zip(params.sessions, snakemake.output.views, strict=True):
    write_table(path, result.views[name])
