rule board:
    input:
        samples=of_members(each_session("samples.parquet")),
        quality=of_members(each_session("quality.json")),
        segments=of_members(each_session("segments.parquet")),
        noise=of_members(lambda each: [f"results/{each.device}/noise.json"]),
        calibration=of_members(lambda each: [f"results/{each.device}/calibration.json"]),
    output:
        board="results/boards/{board}/board.json",
    log:
        "logs/board/{board}.log",
    benchmark:
        "benchmarks/board/{board}.tsv"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        # all logs at once
        mem_mb=lambda wildcards, input, attempt: ceil(attempt * (500 + 30 * input.size_mb)),
        runtime=10,
    params:
        devices=lambda wildcards: [
            settings("gravity", "full_scale")(each) for each in members(wildcards)
        ],
        code=code("board.py"),
    script:
        "../../scripts/board.py"
