"""Join the devices' parts to the report."""

from imuloop.job_log import open_log
from imuloop.report.report import write_report

open_log(snakemake.log[0], "report")
