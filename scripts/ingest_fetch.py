"""Fetch one file from its public source, or from the mirror."""

from imuloop.ingest.sources import fetch
from imuloop.job_log import open_log

open_log(snakemake.log[0], f"ingest_fetch {snakemake.wildcards.filename}")

fetch(snakemake.params.source, snakemake.output[0], mirror=snakemake.config.get("mirror"))
