"""Write one device's part of the report."""

from pathlib import Path

from imuloop.job_log import open_log
from imuloop.report.page import write_device
from imuloop.report.section import write_section

params, output = snakemake.params, snakemake.output
templates = Path(snakemake.scriptdir).parent / "workflow/templates"
open_log(snakemake.log[0], f"report_device {params.device}")

write_section(
    device=params.device,
    label=params.label,
    folder=Path(output.section).parent,
    sessions={name: each["kind"] for name, each in params.sessions.items()},
    template=templates / "section.html.j2",
    section_path=output.section,
    summary_path=output.summary,
    figures_folder=output.figures,
)
write_device(
    output.page,
    output.section,
    output.summary,
    template=templates / "device.html.j2",
    style=templates / "style.css",
    script=templates / "sorting.js",
)
