"""``imuloop info``: describe a log or a result.

For example:
  imuloop info results/my_imu/calibration.json
  imuloop info flight.csv --columns.acceleration fx,fy,fz --columns.angular_rate p,q,r
  imuloop info acceleration=acc.csv,angular_rate=gyr.csv

FILE is a result, such as calibration.json or samples.parquet, or a raw log of any format that
imuloop reads. Values are given with 1 standard deviation; those after < are 95 % upper limits.
"""

import tempfile
from pathlib import Path

import pandas as pd

from imuloop import Calibration
from imuloop.commands.lines import aligned, say
from imuloop.commands.logs import LOG, Log, metadata_of, write_samples
from imuloop.commands.options import add_keys
from imuloop.core.errors import ImuloopError, plural
from imuloop.core.files import read_json
from imuloop.core.samples import SENSORS, Samples, read_metadata
from imuloop.ingest.json_lines import holds_log
from imuloop.report.data_tables import quality_figures
from imuloop.report.effect_tables import constants_text, parameter_rows
from imuloop.report.numbers import number, text_of
from imuloop.report.results import XYZ, DeviceResults
from imuloop.report.tables import coefficient_table, misalignment_table, parameter_table
from imuloop.result import verdict_lines


def add(command):
    """Add the arguments of ``imuloop info`` to `command`, its argparse parser."""
    command.add_argument("file", type=Log.parse, metavar="FILE", help=f"a result, or a log: {LOG}")
    add_keys(command)


def run(arguments):
    """Print the content of a file; return 1 for a log that is rejected, else 0.

    `arguments` are those that `add` declares, parsed.
    """
    # a log of two files cannot be a result
    path = arguments.file.files.get("log", Path())
    metadata = metadata_of(path)
    if path.suffix == ".json" and path.is_file() and not holds_log(path):
        say(*result_lines(path))
    elif metadata.get("calibrated"):
        table = Samples(path)
        count = plural(len(table), "sample")
        say(f"calibrated samples of {metadata['device']}: {count}, {', '.join(table.names)}")
    else:
        lines, rejected = log_lines(arguments.file, arguments.declared)
        say(*lines)
        return int(rejected)
    return 0


def result_lines(path):
    """Return the content of a result of imuloop, a JSON file at `path`, as lines of text, a list.

    Raises an ImuloopError for a file that is not a result.
    """
    content = read_json(path)
    keys = content.keys() if isinstance(content, dict) else {*()}
    try:
        if {*SENSORS} & keys:
            return calibration_lines(Calibration.from_json(path))
        if "axes" in keys:
            return noise_lines(content)
        if "sensors" in keys:
            return [f"diagnosis of {content['device']}", *verdict_lines(content)]
        if {"status", "rows"} <= keys:
            return quality_lines(content)
        # attitude.json, family.json, summary.json; exports.json
        if "format" in keys or keys == {"sha256"}:
            return [path.name, *aligned(pd.json_normalize(content).iloc[0].items())]
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ImuloopError(f"{path}: not a result of this version: {error!r}") from error
    listed = ", ".join(map(str, keys)) or "no keys"
    raise ImuloopError(
        f"{path}: no result of imuloop: {listed[:200]}; a log in JSON is not one document, but "
        "has an object per line"
    )


def calibration_lines(calibration):
    """Return the parameters ± 1 σ and the effects of a Calibration as lines of text, a list."""
    head = f"calibration of {calibration.device}, gravity {calibration.gravity:.6g} m/s²"
    lines = [f"{head}: x = T (K (raw - b) - e)"]
    device = DeviceResults("", "", Path(), calibrations={"final": calibration})
    for sensor in SENSORS:
        fit = getattr(calibration, sensor)
        lines.append(f"{sensor}: raw unit {fit.raw_unit.name}")
        lines += [f"  not determined: {fit.not_testable}"] if fit.not_testable else []
        tables = parameter_table(device, sensor), misalignment_table(device, sensor)
        for table in filter(None, tables):
            lines += [f"  {table.caption}", *aligned([table.columns, *table.rows], indent=4)]
        if sensor in calibration.updated:
            lines.append(f"  bias of a later log: {calibration.updated[sensor]}")
        for effect in fit.effects:
            content = effect.to_dict()
            shape = constants_text(content["constants"])
            lines.append(f"  effect {effect.name}{f' ({shape})' if shape else ''}")
            rows = parameter_rows(content | {"units": effect.effect.units(sensor)})
            lines += aligned(rows, indent=4)
    return lines


def noise_lines(content, data_sheet=None):
    """Return the noise coefficients of a device as lines of text, a list.

    `content` is the content of noise.json. `data_sheet` is None or a dict: its key ``noise`` has
    the typical white noise of the sensors, SI.
    """
    rate = content.get("rate_hz")
    at = f", at {number(rate, 5)} Hz" if rate else ""
    lines = [f"noise of {content['device']}{at}, from {', '.join(content.get('sessions', []))}"]
    device = DeviceResults("", "", Path(), noise=content, data_sheet=data_sheet or {})
    # if no sensor has a rate, list both, without numbers
    for sensor in content.get("rates_hz") or SENSORS:
        rows = coefficient_table(device, sensor).rows
        lines += aligned([(sensor, "", *XYZ), *rows], indent=0)
    return [*lines, *(f"note: {note}" for note in content.get("notes", ()))]


def quality_lines(content):
    """Return rate, duration, ranges and faults of a log as lines of text, a list.

    `content` is the content of its quality.json.
    """
    figures = quality_figures(content) | {"Columns": text_of(content.get("columns"))}
    rows = [row for row in figures.items() if row[1] not in ("0", "none", "—")]
    lines = [f"{content['status']}: {plural(content['rows'], 'sample')}", *aligned(rows)]
    # a rejected log has no ranges
    spans = {name: span for name, span in (content.get("range") or {}).items() if span}
    lines += [f"  {name}  {low:.6g} to {high:.6g}" for name, (low, high) in spans.items()]
    lines += [f"rejected: {reason}" for reason in content["reasons"]]
    return [*lines, *(f"warning: {warning}" for warning in content["warnings"])]


def log_lines(log, declared):
    """Return two results on a log: a list of lines that describe it, and whether it is rejected.

    `log` is the Log, and `declared` are declarations about it, keys of a config.
    """
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        path, quality = write_samples(log, declared, Path(folder))
    rejected = quality.get("status") == "rejected"
    if path != log.files.get("log"):
        first = f"{log.name}: log, format {quality['log_format'] or 'unknown'}"
        return [first, *quality_lines(quality)], rejected
    origin, table = read_metadata(path), Samples(path)
    first = f"samples of {origin['device']}, session {origin['session']}, {origin['kind']}"
    rows = [plural(len(table), "sample"), f"columns: {', '.join(table.names)}"]
    return [first, *(quality_lines(quality) if quality else rows)], rejected
