"""Raw logs of a device whose truth is known."""

import json
import zlib
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.errors import ImuloopError
from imuloop.core.files import replaced
from imuloop.core.samples import METADATA_KEY, SENSORS, TEMPERATURE, TIME
from imuloop.model.effect import Channels
from imuloop.simulate.course import at_rest, poses
from imuloop.simulate.motion import chain
from imuloop.simulate.sensor import lagged, logged, logged_temperature, output


def _seeds(truth, session, seed):
    """Return the seeds of a session, a list of SeedSequence: motion, two sensors, thermometer.

    `truth` is the Truth of a device, and `session` the name of one of its sessions. `seed` is a
    number; if it is None, the seed of the session is used. Sessions and devices with the same
    number have different seeds.
    """
    number = truth.sessions[session].seed if seed is None else seed
    name_hash = zlib.crc32(f"{truth.name}/{session}".encode())
    return np.random.SeedSequence([number, name_hash]).spawn(4)


def true_motion(truth, session, seed=None):
    """Return the true Motion of a simulated session: attitude, rate and force at each sample.

    The log of this motion is what `simulate_session` returns for the same arguments. `truth` is the
    Truth of a device, and `session` the name of one of its sessions. `seed` is a number that
    replaces the seed of the session; by default none does.
    """
    plan = truth.sessions[session]
    rng = np.random.default_rng(_seeds(truth, session, seed)[0])
    course = at_rest if plan.kind == "static" else poses
    pieces, up = course(plan, truth.rate, rng)
    return chain(pieces, up, truth.gravity, truth.rate)


def simulate_session(truth, session, seed=None):
    """Return the raw log of a simulated session.

    Parameters
    ----------
    truth : Truth
        The device: its sensors and the plans of its sessions.
    session : str
        Name of one of its sessions.
    seed : int, optional
        Number that replaces the seed of the session; by default none does.

    Returns
    -------
    DataFrame
        The columns `t`, s; `ax` to `gz`, in the raw units of the sensors; and `temperature`, degC,
        if the session has a temperature profile.

    Raises
    ------
    ImuloopError
        If the device has no such session, or an effect needs a temperature and the session has
        none.
    """
    if session not in truth.sessions:
        names = ", ".join(truth.sessions)
        raise ImuloopError(f"{truth.name}: no session '{session}'; it has {names}")
    plan, dt = truth.sessions[session], 1 / truth.rate
    effects = [e.effect for name in SENSORS for e in getattr(truth, name).effects]
    if not plan.temperature and any("temperature" in effect.needs for effect in effects):
        raise ImuloopError(f"{truth.name}.{session}: an effect needs a temperature profile")
    motion, temperature = true_motion(truth, session, seed), None
    if plan.temperature:
        around = np.interp(motion.t, *np.transpose(plan.temperature))
        temperature = lagged(around, dt, plan.thermal_s)
    true_vectors = [motion.specific_force, motion.angular_rate]
    _, *sensor_seeds, thermal_seed = _seeds(truth, session, seed)
    log = {TIME: motion.t}
    for k, (name, columns) in enumerate(SENSORS.items()):
        sensor, other = getattr(truth, name), true_vectors[1 - k]
        # an effect depends on the true output of the other sensor
        channels = partial(Channels, motion.t, other=other, temperature=temperature)
        u = output(sensor, true_vectors[k], channels)
        bias = np.add(sensor.b, (plan.turn_on or {}).get(name, 0.0))
        raw = logged(sensor, u, bias, dt, sensor_seeds[k])
        log |= dict(zip(columns, raw.T, strict=True))
    if temperature is not None:
        log[TEMPERATURE] = logged_temperature(truth.thermometer, temperature, dt, thermal_seed)
    return pd.DataFrame(log)


def write_log(path, log, metadata):
    """Write the raw log `log`, a DataFrame, as CSV or Parquet file.

    It is CSV if `path` ends with ``.csv``, else Parquet. A Parquet file also gets the dict
    `metadata` and ``"simulated": true``.
    """
    with replaced(path) as temporary:
        if Path(path).suffix == ".csv":
            log.to_csv(temporary, index=False)
        else:
            content = json.dumps({"simulated": True, **metadata}).encode()
            table = pa.Table.from_pandas(log, preserve_index=False)
            pq.write_table(table.replace_schema_metadata({METADATA_KEY: content}), temporary)


def log_metadata(truth, session):
    """Return the metadata of a simulated log, a dict.

    The metadata are the names of device and session, the kind of the session and the units of the
    sensors. `truth` is the Truth of a device, and `session` the name of one of its sessions.
    """
    units = {
        "acceleration": truth.accelerometer.raw_unit,
        "angular_rate": truth.gyroscope.raw_unit,
    }
    kind = truth.sessions[session].kind
    return {"truth": truth.name, "session": session, "kind": kind, "units": units}
