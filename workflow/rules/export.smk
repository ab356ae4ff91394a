rule export:
    input:
        calibration="results/{device}/calibration.json",
        noise="results/{device}/noise.json",
        quality=each_session("quality"),
    output:
        exports=directory("results/{device}/exports"),
        # a folder has no checksum; its list tells what follows whether a file in it changed
        listed="results/{device}/exports.json",
    log:
        "logs/export/{device}.log",
    benchmark:
        "benchmarks/export/{device}.tsv"
    group:
        GROUP
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        **asked(mem_mb=(200, 0), runtime=(5, 0)),
    params:
        device="{device}",
        label=setting("label"),
        code=code("export.py"),
    script:
        "../../scripts/export.py"
