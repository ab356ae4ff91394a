"""Join the devices' parts to the report."""

from pathlib import Path

from imuloop.job_log import open_log
from imuloop.report.provenance import provenance
from imuloop.report.report import write_report

params = snakemake.params
repository = Path(snakemake.scriptdir).parent
templates = repository / "workflow/templates"
open_log(snakemake.log[0], "report")

write_report(
    sections=snakemake.input.sections,
    summaries=snakemake.input.summaries,
    exports=snakemake.input.exports,
    template=templates / "report.html.j2",
    style=templates / "style.css",
    script=templates / "sorting.js",
    provenance=provenance(repository, params.command, params.config),
    report_path=snakemake.output.report,
    comparison_path=snakemake.output.comparison,
)
