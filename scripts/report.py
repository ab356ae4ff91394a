"""Join the devices' parts to the report."""

from pathlib import Path

import imuloop
from imuloop.job_log import open_log, say
from imuloop.report.provenance import provenance
from imuloop.report.report import verdict_lines, write_report

params, output = snakemake.params, snakemake.output
open_log(snakemake.log[0], "report")

folders = [Path(path).parent for path in snakemake.input.sections]
repository = Path(imuloop.__file__).parents[3]
made_by = provenance(imuloop.__version__, repository, params.command, params.config)
family = snakemake.input.family
write_report(folders, made_by, output.report, output.comparison, *family)
for line in verdict_lines(folders):
    say(line)
