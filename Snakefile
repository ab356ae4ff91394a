"""The workflow for who calls it in a clone; all of it is in workflow/Snakefile."""


include: "workflow/Snakefile"


# what an included file has for its default target Snakemake does not take
rule default:
    default_target: True
    input:
        rules.all.input,
