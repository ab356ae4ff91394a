"""Bring one raw log into the canonical samples and measure its quality."""

from imuloop.core.files import read_json
from imuloop.ingest.ingest import ingest
from imuloop.job_log import open_log, tell, teller

params = snakemake.params
session = f"{params.device}/{params.session}"
open_log(snakemake.log[0], f"ingest {session}")

ingest(
    device=params.device,
    session=params.session,
    **params.declared,
    nominal=params.nominal,
    full_scale=params.full_scale,
    paths=list(snakemake.input.log),
    samples_path=snakemake.output.samples,
    quality_path=snakemake.output.quality,
    threads=snakemake.threads,
    progress=teller(session),
)

quality = read_json(snakemake.output.quality)
for line in (*(f"rejected: {reason}" for reason in quality["reasons"]), *quality["warnings"]):
    tell(f"{session}: {line}")
