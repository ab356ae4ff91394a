rule segment:
    input:
        samples="results/{device}/{session}/samples.parquet",
    output:
        segments="results/{device}/{session}/segments.parquet",
    log:
        "logs/segment/{device}/{session}.log",
    benchmark:
        "benchmarks/segment/{device}/{session}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(850, 300),
        runtime=by_size(5, 5),
    params:
        device=settings("segment"),
        code=code("segment.py"),
    script:
        "../../scripts/segment.py"
