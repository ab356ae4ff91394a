"""From raw logs of inertial sensors to results/report.html; one word a stage."""

import sys

from snakemake.utils import min_version

min_version("9.27")


include: "workflow/rules/library.smk"


if not workflow.configfiles:
    from imuloop.config_faults import unreadable

    if fault := unreadable("config.yaml"):
        print(fault, file=sys.stderr)
        sys.exit(1)

    configfile: "config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/storage.smk"
include: "workflow/rules/simulate.smk"
include: "workflow/rules/ingest.smk"
include: "workflow/rules/segment.smk"
include: "workflow/rules/noise.smk"
include: "workflow/rules/calibrate.smk"
include: "workflow/rules/diagnose.smk"
include: "workflow/rules/export.smk"
include: "workflow/rules/report.smk"


rule all:
    default_target: True
    input:
        "results/report.html",
