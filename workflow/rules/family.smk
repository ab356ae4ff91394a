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
        types=TYPES,
        code=code("family.py"),
    script:
        "../../scripts/family.py"
