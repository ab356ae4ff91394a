# templates of every page
PAGE = ("page.html.j2", "card.html.j2", "phrases.j2", "words.yaml", "style.css", "page.js")
# templates of the files of other tools
EXPORTS = sorted(f"export/{path.name}" for path in (TEMPLATES / "export").iterdir())


rule report_device:
    input:
        unpack(
            session_files("samples.parquet", "quality.json", "segments.parquet", "allan.parquet")
        ),
        spectra="results/{device}/spectra.parquet",
        noise="results/{device}/noise.json",
        six_position="results/{device}/six_position.json",
        multi_position="results/{device}/multi_position.json",
        calibration="results/{device}/calibration.json",
        diagnosis="results/{device}/diagnosis.json",
        attitude="results/{device}/attitude.json",
        attitude_series="results/{device}/attitude.parquet",
        poses="results/{device}/poses.parquet",
        moves="results/{device}/moves.parquet",
        reference="results/{device}/reference.parquet",
    output:
        page="results/{device}/report.html",
        section="results/{device}/section.html",
        summary="results/{device}/summary.json",
        exports=directory("results/{device}/exports"),
        # a folder has no checksum; its list tells what follows whether a file in it changed
        listed="results/{device}/exports.json",
        figures=report(
            directory("results/{device}/figures"),
            patterns=["{figure}.svg"],
            caption="../report/figure.rst",
            category="Devices",
            subcategory="{device}",
            labels={"figure": "{figure}"},
        ),
    log:
        "logs/report_device/{device}.log",
    benchmark:
        "benchmarks/report_device/{device}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(850, 600),
        runtime=by_size(5, 2),
    params:
        device=settings("label", "data_sheet"),
        code=code("report_device.py", "export", "report"),
        templates=templates("section.html.j2", "table.html.j2", "device.html.j2", *PAGE, *EXPORTS),
    script:
        "../../scripts/report_device.py"


rule report:
    input:
        sections=expand("results/{device}/section.html", device=DEVICES),
        summaries=expand("results/{device}/summary.json", device=DEVICES),
        exports=expand("results/{device}/exports.json", device=DEVICES),
        family=["results/family.json"] if TYPES else [],
        # newer than a report without all devices: the next run makes it again
        attempt=ask_for_report,
    output:
        report=report(
            "results/report.html",
            caption="../report/report.rst",
            category="Comparison",
            labels={"figure": "all devices, all parts"},
        ),
        comparison=report(
            "results/comparison.csv",
            caption="../report/comparison.rst",
            category="Comparison",
            labels={"figure": "a row per device, SI"},
        ),
        figures=report(
            directory("results/figures"),
            patterns=["{figure}.svg"],
            caption="../report/figure.rst",
            category="Comparison",
            labels={"figure": "{figure}"},
        ),
    log:
        "logs/report/report.log",
    benchmark:
        "benchmarks/report/report.tsv"
    localrule: True
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    params:
        # a function, as braces in a name of a file are to stay
        command=lambda wildcards: COMMAND,
        config=DEVICES,
        code=code("report.py"),
        templates=templates("report.html.j2", "family.html.j2", "table.html.j2", *PAGE),
    script:
        "../../scripts/report.py"


rule attempt:
    output:
        touch(ATTEMPT),
    localrule: True


# a target: the results of each device, nothing of all together
rule devices:
    input:
        expand("results/{device}/section.html", device=share(DEVICES)),
