rule segment:
    input:
        samples="results/{device}/{session}/samples.parquet",
        quality="results/{device}/{session}/quality.json",
    output:
        "results/{device}/{session}/segments.parquet",
    log:
        "logs/segment/{device}/{session}.log",
    benchmark:
        "benchmarks/segment/{device}/{session}.tsv"
    group:
        GROUP
    conda:
        "../envs/imuloop.yaml"
    threads: threads_by_size
    resources:
        mem_mb=asked(500, 300),
        runtime=asked(5, 5),
    params:
        kind=lambda wildcards: session_of(wildcards)["kind"],
        settings=setting("segment"),
        code=code("segment.py"),
    script:
        "../../scripts/segment.py"
