# A rule a device, as for the noise: the Allan tables of its sessions, with the corrected curves.
for device, resolved in DEVICES.items():
    used = session_files(device)

    rule:
        name:
            f"diagnose_{device}"
        input:
            samples=[files["samples"] for files in used.values()],
            segments=[files["segments"] for files in used.values()],
            allan=[files["allan_raw"] for files in used.values()],
            noise=f"results/{device}/noise.json",
            six_position=f"results/{device}/six_position.json",
            multi_position=f"results/{device}/multi_position.json",
        output:
            diagnosis=f"results/{device}/diagnosis.json",
            calibration=f"results/{device}/calibration.json",
            attitude=f"results/{device}/attitude.json",
            attitude_series=f"results/{device}/attitude.parquet",
            allan=[files["allan"] for files in used.values()],
        log:
            f"logs/diagnose/{device}.log",
        benchmark:
            f"benchmarks/diagnose/{device}.tsv"
        conda:
            "../envs/imuloop.yaml"
        threads: 1
        params:
            device=device,
            sessions=used,
            gravity=resolved["gravity"],
            calibrate_settings=resolved["calibrate"],
            settings=resolved["diagnose"],
            noise_settings=resolved["noise"],
            code=code("diagnose.py"),
        script:
            "../../scripts/diagnose.py"
