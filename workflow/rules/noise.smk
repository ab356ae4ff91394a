# A rule a device, because each writes the Allan tables of its own sessions. All sessions go in: a
# rest in any of them stands in where the static ones turn out to be rejected.
for device, resolved in DEVICES.items():
    used = session_files(device)

    rule:
        name:
            f"noise_{device}"
        input:
            samples=[files["samples"] for files in used.values()],
            segments=[files["segments"] for files in used.values()],
        output:
            noise=f"results/{device}/noise.json",
            allan=[files["allan_raw"] for files in used.values()],
            views=[files["views"] for files in used.values()],
        log:
            f"logs/noise/{device}.log",
        benchmark:
            f"benchmarks/noise/{device}.tsv"
        conda:
            "../envs/imuloop.yaml"
        threads: 1
        params:
            device=device,
            sessions=used,
            settings=resolved["noise"],
            code=code("noise.py"),
        script:
            "../../scripts/noise.py"
