"""Calibration without a config: from logs in memory or in files to the `Result` of a device."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pandas as pd
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from imuloop import chain
from imuloop.config import OF_LOGS, known_figures
from imuloop.core.errors import ImuloopError, ImuloopWarning
from imuloop.core.files import make_folder, refuse_overwriting
from imuloop.core.samples import read_samples
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.declaration import check_declared
from imuloop.in_memory import FILE, log_of
from imuloop.ingest.places import PYTHON, read_in
from imuloop.result import IN_MEMORY, Result, TemporaryFolder

KINDS = ("multi_position", "six_position", "static")
# types that `calibrate` takes for a log
Log = str | Path | pd.DataFrame | tuple | Mapping


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
    """Return the Result of one device: its calibration, noise and diagnosis, from its logs.

    Stages and numbers are the same as in the workflow.

    Parameters
    ----------
    t : array_like, shape (n,), or a log, or a list of logs, optional
        Time stamps, s, of the arrays that follow; or one or several logs in which the device rests
        in many attitudes. A log is a path, a DataFrame, a tuple of arrays
        ``(t, acceleration, angular_rate[, temperature])``, or a mapping of ``acceleration`` and
        ``angular_rate`` to a path or a DataFrame each. It may also be an array, (n, k), of n
        samples with k columns, if `columns` names its columns by number from 0.
    acceleration, angular_rate : array_like, shape (n, 3), or path or DataFrame, optional
        Specific force, m/s^2, and angular rate, rad/s, or in the declared `units`. Without `t` they
        are arrays at the sampling rate `rate`, or a path or DataFrame for each sensor, with its own
        time stamps.
    temperature : array_like, shape (n,), optional
        Temperature of the sensors, degC.
    static, six_position : a log, or a list of logs
        Logs of the device at rest, and logs in which each of its six faces is up in turn.
    gravity : float or mapping
        Local gravity, m/s^2, or ``latitude``, degrees, and ``height``, m, to compute it from.
    units, columns, sensor, range, nominal, rate, format : optional
        Declarations about all logs, as in the config. By default columns and format are found in
        each log, and units are SI.
    prior : path-like, optional
        An earlier calibration.json of the device, or a family.json of its type.
    name, label : str
        Name of the device, and its name in the report.
    settings : mapping, optional
        Settings of the stages by their name, as in the config.
    folder : path-like, optional
        Folder that keeps the results; by default they are kept as long as the `Result` exists.
    progress : bool
        Whether to show the progress.

    Raises
    ------
    ImuloopError
        If a log does not exist, or is not as declared.

    Warns
    -----
    ImuloopWarning
        For each log that was rejected, and for each fact that the user should look at in a log. The
        `failures` and `notes` of the result are lists of them.
    """
    arrays = (t, acceleration, angular_rate, temperature)
    poses = _list_logs(t) if all(x is None for x in arrays[1:]) else [arrays]
    lists = zip(KINDS, (poses, _list_logs(six_position), _list_logs(static)), strict=True)
    logs = {
        f"{kind}_{i + 1}": log_of(log, columns, "log" if kind == KINDS[0] else kind)
        for kind, logs_of_kind in lists
        for i, log in enumerate(logs_of_kind)
    }
    if not logs:
        raise ImuloopError("no log is given: t, or acceleration and angular_rate")
    if prior is not None and not (isinstance(prior, FILE) and Path(prior).is_file()):
        raise ImuloopError(f"prior: {prior}: there is no such file")
    declared = {"format": format, "rate": rate, "columns": columns, "units": units}
    declared |= {"sensor": sensor, "range": range, "nominal": nominal}
    declared |= {} if gravity == STANDARD_GRAVITY else {"gravity": gravity}
    with read_in(PYTHON):
        declared = check_declared(declared, name, settings)
    temporary = None if folder else TemporaryFolder()
    if folder:
        make_folder(folder)
        refuse_overwriting([folder], [prior] if prior else [])
    device = chain.Device(
        name,
        Path(folder or temporary.name),
        {session: session.rpartition("_")[0] for session in logs},
        label=label,
        **known_figures(declared),
        prior={"file": str(prior)} if prior else {},
        **{stage: dict(of) for stage, of in (settings or {}).items()},
    )
    steps = [(f"ingest {n}", partial(_ingest, device, n, log, declared)) for n, log in logs.items()]
    # a folder that is removed gets Allan curves only when a picture needs them
    stages = [stage for stage in chain.stages() if folder or stage is not chain.allan]
    steps += [(stage.__name__, partial(stage, device)) for stage in stages]
    # no remaining time is shown, as stages take different times
    shown = "{desc}{bar} {n_fmt} of {total_fmt} steps done, {elapsed}"
    bar = tqdm(steps, disable=not progress, leave=False, bar_format=shown)
    # the matrices are small: threads within a product slow it down
    with bar, threadpool_limits(1, "blas"):
        for words, step in bar:
            bar.set_description(words)
            step()
    result = Result(device, temporary)
    for text in (*result.failures, *result.notes):
        # the warning names the line that calls `imuloop.calibrate`
        warnings.warn(f"{name}: {text}", ImuloopWarning, stacklevel=3)
    return result


def read(log, **declared) -> pd.DataFrame:
    """Return the samples of a log: `t` (s), `ax ay az` (m/s^2), `gx gy gz` (rad/s), `temperature`.

    Parameters
    ----------
    log : path-like, DataFrame or tuple of arrays
        The log; a tuple is ``(t, acceleration, angular_rate[, temperature])``.
    **declared
        ``units``, ``columns``, ``format``, ``rate``, ``sensor``, ``range`` and ``nominal`` of the
        log, as in the config.

    Raises
    ------
    ImuloopError
        If the log cannot be used; the message gives the reasons in one line.

    Warns
    -----
    ImuloopWarning
        For each fact that the user should look at in the log.
    """
    with read_in(PYTHON):
        declared = check_declared(declared)
    log = log_of(log, declared.get("columns"))
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        device = chain.Device("log", Path(folder), {"log": None}, **known_figures(declared))
        _ingest(device, "log", log, declared)
        result = Result(device)
        for failure in result.failures:
            raise ImuloopError(failure)
        for text in result.notes:
            warnings.warn(text, ImuloopWarning, stacklevel=2)
        return read_samples(device.sessions["log"]["samples"])


def _list_logs(logs):
    """Return the logs in an argument of `calibrate` as a list, empty for None or ().

    `logs` is the argument: a list of logs, or one log, which may be a tuple of arrays.
    """
    if logs is None or (isinstance(logs, tuple) and not logs):
        return []
    return logs if isinstance(logs, list) else [logs]


@read_in(PYTHON)
def _ingest(device, session, log, declared):
    """Read the log of a session, and write its samples and quality into the folder of its Device.

    `device` is the Device, and `session` the name of the session. `log` is a path or a DataFrame,
    or a dict with one of these for each sensor. `declared` are the declarations about the log, keys
    of a config. Raises an ImuloopError if they do not fit the log.
    """
    parts, paths, sources = log if isinstance(log, dict) else {"log": log}, [], {}
    for role, part in parts.items():
        if isinstance(part, FILE):
            paths.append(Path(part))
            refuse_overwriting([device.folder], paths[-1:])
            sources[role] = {"path": str(part)}
        else:
            name = f"{session}_{role}" if len(parts) > 1 else session
            paths.append(device.file(f"{name}.parquet"))
            device.folder.mkdir(parents=True, exist_ok=True)
            part.to_parquet(paths[-1], index=False)
            sources[role] = {"path": IN_MEMORY}
    try:
        of_log = {key: declared[key] for key in OF_LOGS if key in declared}
        chain.ingest(device, session, of_log | {"sources": sources}, paths)
    except ImuloopError as error:
        # the message of the stage names device and session, too; the name of the file is enough. A
        # log in memory is called by its session, not by the file that was written here
        why = str(error).removeprefix(f"{device.name}/{session}: ")
        for path, source in zip(paths, sources.values(), strict=True):
            why = why.replace(str(path), session) if source["path"] == IN_MEMORY else why
        raise ImuloopError(why) from error
