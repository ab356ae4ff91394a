# Rules as for the noise: one job for all sessions of a device, one after the other.
for number, (names, devices) in enumerate(ALIKE.items(), 1):

    rule:
        name:
            f"segment_{number}"
        input:
            samples=expand("results/{{device}}/{name}/samples.parquet", name=names),
        output:
            expand("results/{{device}}/{name}/segments.parquet", name=names),
        log:
            "logs/segment/{device}.log",
        benchmark:
            "benchmarks/segment/{device}.tsv"
        wildcard_constraints:
            device=devices,
        group:
            GROUP
        conda:
            "../envs/imuloop.yaml"
        threads: threads_by_size
        resources:
            **asked(mem_mb=(500, 300), runtime=(5, 5), of=max),
        params:
            device="{device}",
            kinds=kinds,
            settings=setting("segment"),
            code=code("segment.py"),
        script:
            "../../scripts/segment.py"
