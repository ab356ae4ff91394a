rule type:
    input:
        samples=of_members(each_session("samples.parquet")),
        segments=of_members(each_session("segments.parquet")),
        noise=of_members(lambda each: [f"results/{each.device}/noise.json"]),
        calibration=of_members(lambda each: [f"results/{each.device}/calibration.json"]),
    output:
        type="results/types/{type}/type.json",
    log:
        "logs/type/{type}.log",
    benchmark:
        "benchmarks/type/{type}.tsv"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        # all logs at once
        mem_mb=lambda wildcards, input, attempt: ceil(attempt * (500 + 30 * input.size_mb)),
        runtime=10,
    params:
        devices=lambda wildcards: [
            settings("gravity", "calibrate", "diagnose")(each) for each in members(wildcards)
        ],
        code=code("type.py"),
    script:
        "../../scripts/type.py"
