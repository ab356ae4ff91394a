# Without a digest of its code: the SHA-256 fixes its output.
rule ingest_fetch:
    output:
        f"{CACHE}/{{sha256}}/{{filename}}",
    log:
        "logs/ingest_fetch/{sha256}/{filename}.log",
    benchmark:
        "benchmarks/ingest_fetch/{sha256}/{filename}.tsv"
    # a node of a cluster may have no network
    localrule: True
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    params:
        source=lambda wildcards: FETCHED[f"{wildcards.sha256}/{wildcards.filename}"],
    script:
        "../../scripts/ingest_fetch.py"


rule ingest:
    input:
        unpack(source_files),
    output:
        samples="results/{device}/{session}/samples.parquet",
        quality="results/{device}/{session}/quality.json",
    log:
        "logs/ingest/{device}/{session}.log",
    benchmark:
        "benchmarks/ingest/{device}/{session}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(950, 6500),
        runtime=by_size(5, 5),
    params:
        device=settings("nominal", "full_scale"),
        log=log_of,
        code=code_of_ingest,
    script:
        "../../scripts/ingest.py"
