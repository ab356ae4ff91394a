"""Figures of docs/reproduce.md, of the results in this folder: ``python -m bench.figures``."""

import json
from pathlib import Path

import numpy as np


def result(device, name):
    return json.loads(Path("results", device, f"{name}.json").read_text())


def row(name, values, digits=3):
    print(f"{name:<44}", *(f"{v:.{digits}g}" for v in np.ravel(values)))


def main():
    """Print them, from the result files of config/measured.yaml."""
    multi = result("xsens_mti", "multi_position")
    force = multi["accelerometer"]
    row("Xsens accelerometer T01 T02 T12", np.array(force["T"])[np.triu_indices(3, 1)])
    row("Xsens accelerometer K", force["K"], 5)
    row("Xsens accelerometer b", force["b"], 6)
    row("Xsens gyroscope K", multi["gyroscope"]["K"], 5)
    found = result("xsens_mti", "diagnosis")["sensors"]
    norm = found["accelerometer"]["poses"]["residuals"]["gravity_norm"]
    row("Xsens held-out |f| - g, mg", norm["before"] / 9.81744 * 1e3)
    for kind, r in found["gyroscope"]["poses"]["residuals"].items():
        keys = ("in_sample_before", "in_sample_after", "before", "after")
        row(f"Xsens {kind}, fit and held out, deg (/s)", np.degrees([r[key] for key in keys]))
    for method, vertical in result("xsens_mti", "attitude")["methods"].items():
        errors = [vertical["models"][model]["rms_deg"] for model in ("base", "final")]
        row(f"Xsens vertical, {method}, base, final, deg", errors)
        row("Xsens base over final, 95 %", [vertical["base_over_final"], *vertical["ratio_ci95"]])
    motion = found["accelerometer"]["motion"]
    for kind, r in motion["residuals"].items():
        row(f"Xsens {kind}, floor, mm/s", [1e3 * r[key] for key in ("before", "after", "floor")])
    for effect in motion["effects"]:
        for name, value in effect["parameters"].items():
            row(
                f"  {effect['name']} {name} and sigma, 1e-3",
                1e3 * np.array([value, effect["std"][name]]),
            )
    z = result("thermal_chamber", "diagnosis")["sensors"]["accelerometer"]["static_record"]
    z = z["residuals"]["bias"]["sessions"]["static"]["az"]
    row("chamber az before, after", [z["before"], z["after"]])
    for board in (1, 2, 3):
        force = result(f"mpu9150_{board}", "multi_position")["accelerometer"]
        row(f"MPU-9150 board {board} scale factor error, %", (1 / np.array(force["K"]) - 1) * 100)
        row(f"MPU-9150 board {board} bias, m/s^2", force["b"])
    force = result("ferraris", "six_position")["accelerometer"]
    row("Ferraris accelerometer K", force["K"], 6)
    row("Ferraris accelerometer b", force["b"], 4)
    for path in sorted(Path("results").glob("*/diagnosis.json")):
        for sensor, parts in json.loads(path.read_text())["sensors"].items():
            for part, block in parts.items():
                names = (effect["name"] for effect in block["effects"])
                print(path.parent.name, sensor, part, block["verdict"], *names)


if __name__ == "__main__":
    main()
