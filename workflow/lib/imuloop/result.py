"""One device from logs in memory or in files, without a config: what the chain finds."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import tempfile
import textwrap
import warnings
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path
from urllib.parse import quote

import pandas as pd
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits
from tqdm import tqdm

import imuloop
from imuloop import chain
from imuloop.arguments import (
    FILE,
    check_declared,
    check_name,
    check_settings,
    gravity_of,
    log_of,
)
from imuloop.core.errors import ImuloopError, ImuloopWarning
from imuloop.core.files import read_json, refuse_overwriting, replaced
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.places import PYTHON, read_in
from imuloop.core.prior_remarks import remarks
from imuloop.core.samples import SENSORS, read_samples
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest.formats import PAIR
from imuloop.sensors import device_figures

KINDS = ("multi_position", "six_position", "static")
# what can be declared of a log, and of the sensor
OF_LOGS = ("units", "columns", "format", "rate")
OF_SENSOR = ("sensor", "range", "nominal")
# what `calibrate` takes for a log
Log = str | Path | pd.DataFrame | tuple | Mapping
# columns of a result that is printed
WIDTH = 100
# where a log came from that was no file
IN_MEMORY = "in memory"


@dataclass(frozen=True)
class Result:
    """What the chain found out about one device."""

    device: chain.Device  # as the stages took it; its folder has the files of the contract
    logs: dict  # where the log of each session came from: its path, or ``in memory``
    failures: tuple[str, ...] = ()  # a line each: logs that were rejected
    notes: tuple[str, ...] = ()  # a line each: what to look at in a log that was used
    # keeps a temporary folder as long as the result
    _folder: object = field(default=None, repr=False, compare=False)

    @cached_property
    def calibration(self) -> Calibration:
        """The calibration, effects included: the model that was diagnosed."""
        return Calibration.from_json(self.device.file("calibration.json"))

    @cached_property
    def noise(self) -> dict:
        """Noise of each channel, ``ax`` to ``gz``, an `AxisNoise` in SI units."""
        return NoiseModel.from_json(self.device.file("noise.json")).axes

    @cached_property
    def diagnosis(self) -> dict:
        """What diagnosis.json holds."""
        return read_json(self.device.file("diagnosis.json"))

    @property
    def verdict(self) -> dict:
        """Verdict of each sensor in each kind of record, as ``verdict["gyroscope"]["poses"]``."""
        return {
            sensor: {record: block["verdict"] for record, block in records.items()}
            for sensor, records in self.diagnosis["sensors"].items()
        }

    @property
    def plot(self):
        """The report's figures, `imuloop.plot.Plots`."""
        from imuloop.plot import Plots

        return Plots(self.device)

    def report(self, path, command="imuloop.calibrate", linked=True) -> Path:
        """Write the report, one HTML file; return its path.

        Results that are kept are `linked`, relative to it.
        """
        from imuloop.report.provenance import provenance
        from imuloop.report.report import write_report

        path, folder = Path(path), self.device.folder
        chain.export(self.device)
        chain.report_device(self.device)
        sessions = {n: {"kind": k, "log": self.logs[n]} for n, k in self.device.kinds.items()}
        config = {
            "gravity": self.device.gravity,
            "prior": self.device.prior.get("file"),
            "sessions": sessions,
            "data_sheet": self.device.data_sheet,
        }
        repository = Path(imuloop.__file__).parents[3]
        made_by = provenance(imuloop.__version__, repository, command, config)
        write_report([folder], made_by, path, folder / "comparison.csv")
        kept = self._folder is None and linked
        _link(path, self.device.name, folder if kept else None)
        return path

    def export(self, folder) -> list:
        """Write the calibration for other tools into a folder; return the paths."""
        chain.export(self.device)
        Path(folder).mkdir(parents=True, exist_ok=True)
        sources = sorted(self.device.file("exports").iterdir())
        targets = [Path(folder) / source.name for source in sources]
        for source, target in zip(sources, targets, strict=True):
            # it may be the same file
            target.write_bytes(source.read_bytes())
        return targets

    def save(self, folder) -> Path:
        """Copy the result's files into a folder, from which `imuloop.load` reads it; return it."""
        if Path(folder).resolve() != self.device.folder.resolve():
            shutil.copytree(self.device.folder, folder, dirs_exist_ok=True)
        return Path(folder)

    def __reduce__(self):
        # with its files: the folder may be temporary, or of another machine
        folder = self.device.folder
        files = {
            p.relative_to(folder).parts: p.read_bytes() for p in folder.rglob("*") if p.is_file()
        }
        return _unpickled, (self.device, self.logs, self.failures, self.notes, files)

    def __str__(self):
        from imuloop.report.verdict import blocks, sentence

        title = f"{self.device.label or self.device.name}, gravity {self.device.gravity:.6g} m/s²"
        named = self.device.data_sheet.get("sensor")
        title += f", sensor {named}:" if named else ":"
        lines = [title, *self.failures, *self.notes]
        for name in SENSORS:
            sensor = getattr(self.calibration, name)
            lines.append(f"  {name}, calibration: {_basis(sensor)}")
            lines += [f"  {name}: {remark}" for remark in remarks(name, sensor)]
        places = {}
        for sensor, part, block in blocks(self.diagnosis):
            text = sentence(sensor, block)
            places.setdefault(text, []).append(f"{sensor}, {part.replace('_', ' ')}")
        lines += [f"  {'; '.join(where)}: {text}" for text, where in places.items()]
        wrapped = (textwrap.wrap(line, WIDTH, subsequent_indent="    ") for line in lines)
        return "\n".join(line for lines in wrapped for line in lines)

    def __repr__(self):
        verdicts = [f"{s} {r} {v}" for s, of in self.verdict.items() for r, v in of.items()]
        return f"<Result of {self.device.name}: {', '.join(verdicts)}>"

    def _repr_html_(self):
        return f"<pre>{escape(str(self))}</pre>\n{self.calibration._repr_html_()}"


class TemporaryFolder:
    """A folder that is removed, without a warning, when nothing holds it any more."""

    def __init__(self):
        self.name = tempfile.mkdtemp(prefix="imuloop-")
        weakref.finalize(self, shutil.rmtree, self.name, ignore_errors=True)


def _unpickled(device, logs, failures, notes, files):
    """Return a result, its files in a temporary folder."""
    kept = TemporaryFolder()
    for parts, content in files.items():
        path = Path(kept.name, *parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return Result(replace(device, folder=Path(kept.name)), logs, failures, notes, kept)


def load(folder) -> Result:
    """Return the result whose files lie in a folder.

    Parameters
    ----------
    folder : path-like
        ``results/<device>`` of the workflow, ``folder`` of `calibrate`, or that of `Result.save`.
        The label is in it if a report was written.

    Raises
    ------
    ImuloopError
        If the files of a result are not there.
    """
    folder = Path(folder)
    missing = [n for n in ("calibration.json", "diagnosis.json") if not (folder / n).is_file()]
    if missing:
        raise ImuloopError(f"{folder}: no folder of a result: it has no {missing[0]}")
    calibration = Calibration.from_json(folder / "calibration.json")
    sessions = {p.parent.name: read_json(p) for p in sorted(folder.glob("*/quality.json"))}
    kinds = {name: quality["kind"] for name, quality in sessions.items()}
    summary = folder / "summary.json"
    label = read_json(summary)["label"] if summary.is_file() else ""
    logs, failures, notes = {}, [], []
    for name, quality in sessions.items():
        # a source begins with its path or address
        places = (str(next(iter(source.values()))) for source in quality["source"].values())
        logs[name] = " and ".join(dict.fromkeys(places)) or name
        wrong, look = _said(name if logs[name] == IN_MEMORY else logs[name], quality)
        failures, notes = failures + wrong, notes + look
    how = {"label": label, "gravity": calibration.gravity}
    device = chain.Device(calibration.device, folder, kinds, **how)
    return Result(device, logs, tuple(failures), tuple(notes))


def calibrate(
    t: ArrayLike | Log | list[Log] | None = None,
    acceleration: ArrayLike | None = None,
    angular_rate: ArrayLike | None = None,
    temperature: ArrayLike | None = None,
    *,
    static: Log | list[Log] = (),
    six_position: Log | list[Log] = (),
    gravity: float | Mapping = STANDARD_GRAVITY,
    units: Mapping | None = None,
    columns: Mapping | None = None,
    sensor: str | None = None,
    range: Mapping | None = None,
    nominal: Mapping | None = None,
    rate: float | None = None,
    format: str | None = None,
    prior: str | Path | None = None,
    name: str = "device",
    label: str = "",
    settings: Mapping | None = None,
    folder: str | Path | None = None,
    progress: bool = True,
) -> Result:
    """Calibrate and diagnose one device; the same stages, and numbers, as in the workflow.

    Parameters
    ----------
    t : array_like, shape (n,), or a log, or a list of logs, optional
        Time stamps, s, of the arrays that follow; or each log of many positions: a path, a
        DataFrame, a tuple of arrays ``(t, acceleration, angular_rate[, temperature])``, or a
        mapping of ``acceleration`` and ``angular_rate`` to a path or a DataFrame each. An array
        of shape (n, k) needs `columns` by number, from 0.
    acceleration, angular_rate : array_like, shape (n, 3), or path or DataFrame, optional
        m/s^2 and rad/s, or in the `units` that are given. Without `t`: arrays at the `rate`, or a
        path or DataFrame of each sensor with its own time stamps.
    temperature : array_like, shape (n,), optional
        degC.
    static, six_position : a log, or a list of logs
        Of the device at rest, and of its six faces up and down in turn.
    gravity : float or mapping
        Local gravity, m/s^2, or ``latitude``, degrees, and ``height``, m, to compute it from.
    units, columns, sensor, range, nominal, rate, format : optional
        Of all logs, as in the config; what is not given is found from a log, units else SI.
    prior : path-like, optional
        An earlier calibration.json of the device, or a family.json of its type.
    name, label : str
        Name of the device, and that in the report.
    settings : mapping, optional
        Settings of the stages by their name, as in the config.
    folder : path-like, optional
        Where results are kept; without, as long as the result lives.
    progress : bool
        Whether to show how far it is.

    Raises
    ------
    ImuloopError
        If a log does not exist, or is not as declared.

    Warns
    -----
    ImuloopWarning
        For each log that was rejected, stage that failed, and thing to look at in a log; the result
        lists them in its `failures` and `notes`.
    """
    if t is None and (acceleration is None or angular_rate is None):
        raise ImuloopError("no log is given: t, or acceleration and angular_rate")
    if (acceleration is None) != (angular_rate is None):
        lacks = "acceleration" if acceleration is None else "angular_rate"
        raise ImuloopError(f"{lacks}: none is given beside t and the other sensor")
    check_name(name)
    if folder and Path(folder).is_file():
        raise ImuloopError(f"{folder}: a file, where a folder for the results is asked for")
    check_settings(settings or {})
    if prior is not None and not (isinstance(prior, FILE) and Path(prior).is_file()):
        raise ImuloopError(f"prior: {prior}: there is no such file")
    declared = {"format": format, "rate": rate, "columns": columns or {}, "units": units or {}}
    figures = _figures(declared | {"sensor": sensor, "range": range, "nominal": nominal})
    tables = any(isinstance(x, (*FILE, pd.DataFrame)) for x in (acceleration, angular_rate))
    if acceleration is None:
        poses = _several(t)
    elif t is None and tables:
        poses = [dict(zip(PAIR, (acceleration, angular_rate), strict=True))]
    elif t is None and rate is None:
        raise ImuloopError("t: none is given; give it, or the rate of the arrays in Hz")
    else:
        poses = [(t, acceleration, angular_rate, temperature)]
    if temperature is not None and not isinstance(poses[0], tuple):
        raise ImuloopError("temperature: goes with arrays; else it is a column of the log")
    given = zip(KINDS, (poses, _several(six_position), _several(static)), strict=True)
    logs = {
        f"{kind}_{i + 1}": log_of(log, columns, "log" if kind == KINDS[0] else kind)
        for kind, each in given
        for i, log in enumerate(each)
    }
    kept = folder or TemporaryFolder()
    if prior and folder:
        refuse_overwriting([folder], [prior])
    device = chain.Device(
        name,
        Path(folder or kept.name),
        {session: session.rpartition("_")[0] for session in logs},
        label=label,
        gravity=gravity_of(gravity),
        **figures,
        prior={"file": str(prior)} if prior else {},
        **{stage: dict(of) for stage, of in (settings or {}).items()},
    )
    failures, notes = [], []
    count = len(logs) + len(chain.stages())
    # the time that is left is not known: stages differ
    shown = "{desc}{bar} {n_fmt} of {total_fmt} steps done, {elapsed}"
    stages = tqdm(total=count, disable=not progress, leave=False, bar_format=shown)
    # the matrices are small: threads within a product slow it down
    with stages as bar, threadpool_limits(1, "blas"):
        for session, log in logs.items():
            bar.set_description(f"ingest {session}")
            wrong, look = _ingested(device, session, log, declared)
            failures, notes = failures + wrong, notes + look
            bar.update()
        for stage in chain.stages():
            bar.set_description(stage.__name__)
            stage(device)
            bar.update()
    for text in (*failures, *notes):
        # at the line that calls `imuloop.calibrate`
        warnings.warn(f"{name}: {text}", ImuloopWarning, stacklevel=3)
    paths = {session: _where(log) for session, log in logs.items()}
    return Result(device, paths, tuple(failures), tuple(notes), None if folder else kept)


def _link(page, name, folder):
    """Lead a page's links to the results of a device to a folder.

    Without one the page has no links and no words on result files.
    """
    text = page.read_text("utf-8")
    links = rf'<a href="(?:{re.escape(name)}/)?((?:figures|exports)/[^"]*|[\w.]+\.(?:json|csv))">'
    if folder is None:
        text = re.sub("<!-- files -->.*?<!-- /files -->", "", text, flags=re.DOTALL)
        text = re.sub(r"[,:] see diagnosis\.json", "", text)
        text = re.sub(rf" ?{links}(?:CSV|SVG)</a>", "", text)
        text = re.sub(rf"{links}(.*?)</a>", r"\2", text)
    else:
        relative = quote(os.path.relpath(folder, page.parent))
        text = re.sub(links, rf'<a href="{relative}/\1">', text)
        calibration = escape(shlex.quote(str(folder / "calibration.json")))
        text = text.replace(f"results/{name}/calibration.json", calibration)
    with replaced(page) as temporary:
        temporary.write_text(text, "utf-8")


def read(log, **declared) -> pd.DataFrame:
    """Return the samples of a log: `t` (s), `ax ay az` (m/s^2), `gx gy gz` (rad/s), `temperature`.

    Parameters
    ----------
    log : path-like, DataFrame or tuple of arrays
        As of `calibrate`.
    **declared
        ``units``, ``columns``, ``format``, ``rate``, ``sensor``, ``range``, ``nominal``, as of
        `calibrate`.

    Raises
    ------
    ImuloopError
        If the log cannot be used; one line with the reasons.

    Warns
    -----
    ImuloopWarning
        For each thing to look at in the log.
    """
    figures = _figures(declared)
    log = log_of(log, declared.get("columns"))
    kept = {k: v for k, v in declared.items() if v is not None and k not in OF_SENSOR}
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        device = chain.Device("log", Path(folder), {"log": None}, **figures)
        failures, notes = _ingested(device, "log", log, kept)
        for failure in failures:
            raise ImuloopError(failure)
        for text in notes:
            warnings.warn(text, ImuloopWarning, stacklevel=2)
        return read_samples(device.sessions["log"]["samples"])


def _figures(declared):
    """Return the `device_figures` of what is declared; an ImuloopError if that cannot be."""
    check_declared(declared, (*OF_LOGS, *OF_SENSOR))
    return device_figures(*map(declared.get, OF_SENSOR))


def _basis(sensor):
    """Return what a sensor's calibration comes from, with the scale factors and biases found."""
    from imuloop.report.numbers import typeset, with_sigma
    from imuloop.report.tables.calibration import METHOD_WORDS

    text, std, raw = METHOD_WORDS[sensor.method], sensor.std, typeset(sensor.raw_unit.name)
    per = "" if sensor.raw_unit.name in ("m/s^2", "rad/s") else f" SI per {raw}"
    for word, symbol, unit in (("scale factor", "K", per), ("bias", "b", f" {raw}")):
        names = [f"{symbol}{axis}" for axis in range(3)]
        if set(names) <= set(std):
            values = zip(getattr(sensor, symbol), names, strict=True)
            found = ", ".join(with_sigma(value, std[name]) for value, name in values)
            text += f"; {word} {symbol} {found}{unit}"
    if sensor.unimproved:
        text += f"; {sensor.prior['source']}: {', '.join(sensor.unimproved)}"
    return text


def _several(logs):
    """Return a list of logs, of one too: a tuple of arrays."""
    if logs is None or (isinstance(logs, tuple) and not logs):
        return []
    return logs if isinstance(logs, list) else [logs]


def _where(log):
    """Return the path of a log, of two those of both."""
    parts = log.values() if isinstance(log, dict) else [log]
    files = [str(part) for part in parts if isinstance(part, FILE)]
    return " and ".join(files) or IN_MEMORY


@read_in(PYTHON)
def _ingested(device, session, log, declared):
    """Write the samples of a session; return why they cannot be used, and what to look at."""
    parts, paths, sources = log if isinstance(log, dict) else {"log": log}, [], {}
    for role, part in parts.items():
        if isinstance(part, FILE):
            path = Path(part)
            refuse_overwriting([device.folder], [path])
            sources[role] = {"path": str(part)}
        else:
            name = f"{session}_{role}" if len(parts) > 1 else session
            path = device.file(f"{name}.parquet")
            path.parent.mkdir(parents=True, exist_ok=True)
            part.to_parquet(path, index=False)
            sources[role] = {"path": IN_MEMORY}
        paths.append(path)
    shown = _where(log) if _where(log) != IN_MEMORY else session
    declared = declared | {"sources": sources}
    try:
        chain.ingest(device, session, declared, paths)
    except ImuloopError as error:
        # the file's name is enough, and of a log in memory that of its session
        why = str(error).removeprefix(f"{device.name}/{session}: ")
        for path in paths if IN_MEMORY in {s["path"] for s in sources.values()} else ():
            why = why.replace(str(path), session)
        raise ImuloopError(why) from error
    quality = read_json(device.sessions[session]["quality"])
    return _said(shown, quality)


def _said(log, quality):
    """Return why a log cannot be used, and what to look at in it, a line each."""
    why = [f"{log}: rejected: {'; '.join(quality['reasons'])}"] if quality["reasons"] else []
    return why, [f"{log}: {text}" for text in quality["warnings"]]
