rule family_prior:
    input:
        samples=each_session("samples.parquet"),
        segments=each_session("segments.parquet"),
        noise="results/{device}/noise.json",
        multi_position="results/{device}/multi_position.json",
        diagnosis="results/{device}/diagnosis.json",
        calibration="results/{device}/calibration.json",
        # theirs are made without a prior, so no device waits for itself
        others=lambda wildcards: [
            f"results/{name}/calibration.json" for name in others_of_type(wildcards)
        ],
    output:
        calibration="results/{device}/family_calibration.json",
    log:
        "logs/family_prior/{device}.log",
    benchmark:
        "benchmarks/family_prior/{device}.tsv"
    priority: in_order
    group:
        "with_prior"
    conda:
        "../envs/imuloop.yaml"
    threads: 1
    resources:
        mem_mb=by_size(500, 0),
        runtime=by_size(5, 0),
    params:
        device=settings("gravity", "calibrate", "prior"),
        code=code("family_prior.py"),
    script:
        "../../scripts/family_prior.py"


# What waits for other devices has rules and a group of its own: that of its device would wait for
# itself.
ruleorder: export_with_prior > export


use rule export as export_with_prior with:
    wildcard_constraints:
        device="|".join(WITH_PRIOR) or "none",
    group:
        "with_prior"


ruleorder: report_device_with_prior > report_device


use rule report_device as report_device_with_prior with:
    wildcard_constraints:
        device="|".join(WITH_PRIOR) or "none",
    group:
        "with_prior"


rule family:
    input:
        results=[
            f"results/{name}/{file}.json"
            for names in TYPES.values()
            for name in names
            for file in (
                *("calibration", "noise", "diagnosis"),
                *(["family_calibration"] if name in WITH_PRIOR else ()),
            )
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
            kind: {
                name: {key: DEVICES[name][key] for key in ("serial", "date", "prior")}
                for name in names
            }
            for kind, names in TYPES.items()
        },
        code=code("family.py"),
    script:
        "../../scripts/family.py"
