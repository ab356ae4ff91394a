# All sessions go in: a rest in any of them stands in where the static ones turn out to be rejected.
for number, (names, devices) in enumerate(ALIKE.items(), 1):

    rule:
        name:
            f"noise_{number}"
        input:
            samples=expand("results/{{device}}/{name}/samples.parquet", name=names),
            segments=expand("results/{{device}}/{name}/segments.parquet", name=names),
        output:
            noise="results/{device}/noise.json",
            allan=expand("results/{{device}}/{name}/allan_raw.parquet", name=names),
            views=expand("results/{{device}}/{name}/views.parquet", name=names),
        log:
            "logs/noise/{device}.log",
        benchmark:
            "benchmarks/noise/{device}.tsv"
        wildcard_constraints:
            device=devices,
        group:
            GROUP
        conda:
            "../envs/imuloop.yaml"
        threads: threads_by_size
        resources:
            **asked(mem_mb=(500, 700), runtime=(5, 10)),
        params:
            device="{device}",
            kinds=kinds,
            settings=setting("noise"),
            code=code("noise.py"),
        script:
            "../../scripts/noise.py"
