rule family:
    input:
        results=[
            f"results/{name}/{file}.json"
            for names in TYPES.values()
            for name in names
            for file in ("calibration", "noise", "diagnosis")
        ],
    output:
        family="results/family.json",
    log:
        "logs/family/family.log",
    benchmark:
        "benchmarks/family/family.tsv"
    localrule: True
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    params:
        types={
            kind: {name: {key: DEVICES[name][key] for key in ("serial", "date")} for name in names}
            for kind, names in TYPES.items()
        },
        code=code("family.py"),
    script:
        "../../scripts/family.py"
