# what the files of other tools are made with
EXPORTS = sorted(f"export/{path.name}" for path in (TEMPLATES / "export").iterdir())


rule export:
    input:
        calibration="results/{device}/calibration.json",
        noise="results/{device}/noise.json",
        diagnosis="results/{device}/diagnosis.json",
        quality=each_session("quality.json"),
    output:
        exports=directory("results/{device}/exports"),
        # a folder has no checksum; its list tells what follows whether a file in it changed
        listed="results/{device}/exports.json",
    log:
        "logs/export/{device}.log",
    benchmark:
        "benchmarks/export/{device}.tsv"
    priority: in_order
    group:
        "device"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(600, 0),
        runtime=by_size(5, 0),
    params:
        device=settings("label"),
        code=code("export.py"),
        templates=templates(*EXPORTS),
    script:
        "../../scripts/export.py"
