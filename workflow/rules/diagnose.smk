rule diagnose:
    input:
        unpack(session_files("samples.parquet", "segments.parquet", prior=True)),
        noise="results/{device}/noise.json",
        six_position="results/{device}/six_position.json",
        multi_position="results/{device}/multi_position.json",
    output:
        diagnosis="results/{device}/diagnosis.json",
        calibration="results/{device}/calibration.json",
        attitude="results/{device}/attitude.json",
        attitude_series="results/{device}/attitude.parquet",
        poses="results/{device}/poses.parquet",
        moves="results/{device}/moves.parquet",
        reference="results/{device}/reference.parquet",
        allan="results/{device}/allan_corrected.parquet",
    log:
        "logs/diagnose/{device}.log",
    benchmark:
        "benchmarks/diagnose/{device}.tsv"
    priority: in_order
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(1200, 2500, static=300),
        runtime=by_size(10, 10),
    params:
        device=settings("gravity", "noise", "calibrate", "diagnose", "prior", "tolerances"),
        prior=prior_digest,
        code=code("diagnose.py", "calibrate", "family", "model", "noise", "plan", "validate"),
    script:
        "../../scripts/diagnose.py"
