"""Join the devices' parts to the report."""

from pathlib import Path

import imuloop
from imuloop.job_log import open_log
from imuloop.report.provenance import provenance
from imuloop.report.report import write_report

params, output = snakemake.params, snakemake.output
open_log(snakemake.log[0], "report")

write_report(
    [Path(path).parent for path in snakemake.input.sections],
    provenance(Path(imuloop.__file__).parents[3], params.command, params.config),
    output.report,
    output.comparison,
)
