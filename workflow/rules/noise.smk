# All sessions go in: a rest in any of them stands in where the static ones turn out to be rejected.
rule noise:
    input:
        unpack(session_files("samples.parquet", "segments.parquet")),
    output:
        noise="results/{device}/noise.json",
        spectra="results/{device}/spectra.parquet",
    log:
        "logs/noise/{device}.log",
    benchmark:
        "benchmarks/noise/{device}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(750, 700),
        runtime=by_size(5, 10),
    params:
        device=settings("noise"),
        code=code("noise.py"),
    script:
        "../../scripts/noise.py"


rule allan:
    input:
        samples="results/{device}/{session}/samples.parquet",
        segments="results/{device}/{session}/segments.parquet",
        corrected="results/{device}/allan_corrected.parquet",
    output:
        allan="results/{device}/{session}/allan.parquet",
    log:
        "logs/allan/{device}/{session}.log",
    benchmark:
        "benchmarks/allan/{device}/{session}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(750, 700),
        runtime=by_size(5, 5),
    params:
        device=settings("noise"),
        code=code("allan.py", "noise"),
    script:
        "../../scripts/allan.py"
