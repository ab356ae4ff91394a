"""Write one device's part of the report."""

from imuloop.job_log import open_log
from imuloop.report.section import write_section

params = snakemake.params
open_log(snakemake.log[0], f"report_device {params.name}")
