rule simulate:
    input:
        f"{REPOSITORY}/data/replicas/{{replica}}.yaml",
    output:
        "data/simulated/{replica}/{session}.parquet",
    log:
        "logs/simulate/{replica}/{session}.log",
    benchmark:
        "benchmarks/simulate/{replica}/{session}.tsv"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=1100,
        runtime=5,
    params:
        session="{session}",
        code=code("simulate.py"),
    script:
        "../../scripts/simulate.py"
