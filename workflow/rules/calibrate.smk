rule calibrate:
    input:
        unpack(session_files("samples.parquet", "segments.parquet", prior=True)),
        noise="results/{device}/noise.json",
    output:
        six_position="results/{device}/six_position.json",
        multi_position="results/{device}/multi_position.json",
    log:
        "logs/calibrate/{device}.log",
    benchmark:
        "benchmarks/calibrate/{device}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(700, 0),
        runtime=by_size(5, 0),
    params:
        device=settings("gravity", "calibrate", "prior", "tolerances"),
        prior=prior_digest,
        code=code("calibrate.py", "family", "model"),
    script:
        "../../scripts/calibrate.py"
