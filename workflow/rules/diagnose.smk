rule diagnose:
    input:
        samples=each_session("samples"),
        segments=each_session("segments"),
        noise="results/{device}/noise.json",
        six_position="results/{device}/six_position.json",
        multi_position="results/{device}/multi_position.json",
    output:
        diagnosis="results/{device}/diagnosis.json",
        calibration="results/{device}/calibration.json",
    log:
        "logs/diagnose/{device}.log",
    benchmark:
        "benchmarks/diagnose/{device}.tsv"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    params:
        device="{device}",
        sessions=sessions,
        gravity=setting("gravity"),
        calibrate_settings=setting("calibrate"),
        settings=setting("diagnose"),
        code=code("diagnose.py"),
    script:
        "../../scripts/diagnose.py"
