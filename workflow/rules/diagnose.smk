# Rules as for the noise: the Allan tables of the sessions, with the corrected curves.
for number, (names, devices) in enumerate(ALIKE.items(), 1):

    rule:
        name:
            f"diagnose_{number}"
        input:
            samples=expand("results/{{device}}/{name}/samples.parquet", name=names),
            segments=expand("results/{{device}}/{name}/segments.parquet", name=names),
            allan=expand("results/{{device}}/{name}/allan_raw.parquet", name=names),
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
            allan=expand("results/{{device}}/{name}/allan.parquet", name=names),
        log:
            "logs/diagnose/{device}.log",
        benchmark:
            "benchmarks/diagnose/{device}.tsv"
        wildcard_constraints:
            device=devices,
        group:
            GROUP
        conda:
            "../envs/imuloop.yaml"
        threads: 1
        resources:
            **asked(mem_mb=(600, 2500), runtime=(10, 10)),
        params:
            device="{device}",
            kinds=kinds,
            gravity=setting("gravity"),
            calibrate_settings=setting("calibrate"),
            settings=setting("diagnose"),
            noise_settings=setting("noise"),
            code=code("diagnose.py"),
        script:
            "../../scripts/diagnose.py"
