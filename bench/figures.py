"""Figures of docs/reproduce.md, of the results in this folder: ``python -m bench.figures``."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd


def result(device, name):
    return json.loads(Path("results", device, f"{name}.json").read_text())


def row(name, values, digits=6):
    print(f"{name:<34}", *(f"{v:.{digits}g}" for v in np.ravel(values)))


def main():
    """Print them, from the result files of config/measured.yaml."""
    multi = result("xsens_mti", "multi_position")
    force, turn = multi["accelerometer"], multi["gyroscope"]
    T = np.array(force["T"])
    row("Xsens accelerometer T01 T02 T12", T[np.triu_indices(3, 1)])
    row("Xsens accelerometer K", force["K"])
    row("Xsens accelerometer b", force["b"])
    row("Xsens gyroscope K", turn["K"])
    found = result("xsens_mti", "diagnosis")["sensors"]
    norm = found["accelerometer"]["poses"]["residuals"]["gravity_norm"]
    row("Xsens held-out |f| - g, mg", norm["before"] / 9.81744 * 1e3, 3)
    poses = found["gyroscope"]["poses"]
    row("Xsens g_sensitivity p", [e["p_value"] for e in poses["effects"]], 2)
    for key in ("in_sample_before", "in_sample_after", "before", "after"):
        row(f"Xsens rotation {key}, deg", math.degrees(poses["residuals"]["rotation"][key]), 3)
    methods = result("xsens_mti", "attitude")["methods"]
    for method, m in methods.items():
        errors = [e["rms_deg"] for e in m["models"].values()]
        row(f"Xsens vertical, {method}: raw, base, final, deg", errors, 3)
        row("  base over final, 95 %", [m["base_over_final"], *m["ratio_ci95"]], 3)
    row("Xsens vertical, rotation: floor, deg", methods["rotation"]["floor_deg"], 3)
    rate = poses["residuals"]["pose_rate"]
    row("Xsens pose rate before, after, deg/s", np.degrees([rate["before"], rate["after"]]), 3)
    table = pd.read_parquet("results/xsens_mti/poses.parquet")
    for key in ("before", "after"):
        axes = np.degrees(table[[f"pose_rate_{key}_{axis}" for axis in "xyz"]].to_numpy())
        row(f"  {key}: rms of x, y, z", np.sqrt((axes**2).mean(axis=0)), 3)
        row(f"  {key}: mean absolute error of an axis", np.abs(axes).mean(), 3)
    for effect in found["accelerometer"]["static_record"]["effects"]:
        row(f"Xsens at rest: {effect['name']} p", effect["p_value"], 2)
        row("  frequency, Hz", effect["constants"].get("frequency", math.nan), 3)
    motion = found["accelerometer"]["motion"]
    for kind, r in motion["residuals"].items():
        values = [1e3 * r[key] for key in ("before", "after", "floor")]
        row(f"Xsens {kind}: before, after, floor, mm/s", values, 3)
    for effect in motion["effects"]:
        for name, value in effect["parameters"].items():
            row(
                f"  {effect['name']} {name} and sigma, 1e-3",
                [1e3 * value, 1e3 * effect["std"][name]],
                3,
            )
    for sensor in ("accelerometer", "gyroscope"):
        block = result("thermal_chamber", "diagnosis")["sensors"][sensor]["static_record"]
        print(f"chamber {sensor}:", ", ".join(e["name"] for e in block["effects"]))
        for axis, held in block["residuals"]["bias"]["sessions"]["static"].items():
            row(f"  {axis} before, after", [held["before"], held["after"]], 3)
    for board in (1, 2, 3):
        force = result(f"mpu9150_{board}", "multi_position")["accelerometer"]
        row(f"MPU-9150 board {board} scale error, %", (1 / np.array(force["K"]) - 1) * 100, 3)
        row(f"MPU-9150 board {board} bias, m/s^2", force["b"], 3)
        turn = result(f"mpu9150_{board}", "diagnosis")["sensors"]["gyroscope"]["poses"]
        row(
            "  reduced chi-squared of the pose rate",
            turn["residuals"]["pose_rate"]["chi2_after"],
            2,
        )
        for found in turn["candidates"]:
            if found["name"] == "g_sensitivity":
                row(
                    "  G over its standard errors",
                    [v / found["std"][k] for k, v in found["parameters"].items()],
                    2,
                )
    force = result("ferraris", "six_position")["accelerometer"]
    row("Ferraris accelerometer K", force["K"])
    row("Ferraris accelerometer b", force["b"], 4)
    for device in sorted(Path("results").glob("*/diagnosis.json")):
        for sensor, parts in json.loads(device.read_text())["sensors"].items():
            for part, block in parts.items():
                print(device.parent.name, sensor, part, block["verdict"])


if __name__ == "__main__":
    main()
