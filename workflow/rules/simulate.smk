rule simulate:
    input:
        f"{workflow.basedir}/data/replicas/{{replica}}.yaml",
    output:
        "data/simulated/{replica}/{recording}.parquet",
    log:
        "logs/simulate/{replica}/{recording}.log",
    benchmark:
        "benchmarks/simulate/{replica}/{recording}.tsv"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    params:
        recording="{recording}",
        code=code("simulate.py"),
    script:
        "../../scripts/simulate.py"
