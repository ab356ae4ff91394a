"""Write one device's part of the report."""

from pathlib import Path

from imuloop.job_log import open_log
from imuloop.report.section import write_section

params, output = snakemake.params, snakemake.output
open_log(snakemake.log[0], f"report_device {params.device}")

write_section(
    device=params.device,
    label=params.label,
    folder=Path(output.section).parent,
    sessions={name: each["kind"] for name, each in params.sessions.items()},
    template=snakemake.input.template,
    section_path=output.section,
    summary_path=output.summary,
    figures_folder=output.figures,
)
