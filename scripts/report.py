"""Join the devices' parts to the report."""

from imuloop.chain import report
from imuloop.job_log import open_log, say

open_log(snakemake.log[0], "report")

params = snakemake.params
for line in report(params.config, params.command, *snakemake.input.family):
    say(line)
