"""Join the devices' parts to the report."""

from pathlib import Path

from imuloop.job_log import open_log
from imuloop.report.provenance import provenance
from imuloop.report.report import write_report

params = snakemake.params
open_log(snakemake.log[0], "report")

write_report(
    sections=snakemake.input.sections,
    summaries=snakemake.input.summaries,
    exports=[Path(listed).with_suffix("") for listed in snakemake.input.exports],
    template=snakemake.input.template,
    style=snakemake.input.style,
    script=snakemake.input.sorting,
    provenance=provenance(Path(snakemake.scriptdir).parent, params.command, params.config),
    report_path=snakemake.output.report,
    comparison_path=snakemake.output.comparison,
)
