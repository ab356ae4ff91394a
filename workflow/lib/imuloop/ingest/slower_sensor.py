"""Of two sensors with clocks of their own: the quality of the slower one's own samples.

Values that rows hold would look like firmware that holds them, or like a filter, and a spike that
they hold like a step.
"""

import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TIME, Samples
from imuloop.ingest import quality
from imuloop.ingest.increments import SENSORS as QUANTITIES

# faults that quality.json has by channel
BY_CHANNEL = ("failed_reads", "stuck", "spikes", "wraps", "clipped_at")


def first_rows(path, sensor):
    """Return the rows of a samples file in which a sensor has a new sample."""
    own = Samples(path)[OWN_TIME[sensor]]
    return np.flatnonzero(np.diff(own, prepend=-np.inf) > 0)


@contextmanager
def own_samples(path, sensor):
    """Give the path of samples in which each of a sensor is once, at its own stamps."""
    table = pq.read_table(path).take(pa.array(first_rows(path, sensor)))
    own = table[OWN_TIME[sensor]].to_numpy()
    stamps = pa.array(own - own[:1].sum())
    table = table.drop_columns([OWN_TIME[sensor]])
    table = table.set_column(table.column_names.index(TIME), TIME, stamps)
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        target = Path(folder, "own.parquet")
        pq.write_table(table, target)
        yield target


def measure(path, sensor, full_scale, threads):
    """Return quality figures in which the slower sensor's channels are by its own samples.

    Under ``slower`` are the sensor, its rate and its rows. A spike of it is in all rows that hold
    it.
    """
    figures, axes = quality.measure(path, full_scale, threads), SENSORS[sensor]
    with own_samples(path, sensor) as target:
        own = quality.measure(target, full_scale, threads)
    of_slower = np.isin(CHANNELS, axes)
    rows, at = figures["isolated"]
    own_rows, own_at = own["isolated"]
    edges = np.append(first_rows(path, sensor), figures["rows"])
    held = [np.arange(edges[k], edges[k + 1]) for k in np.unique(own_rows[of_slower[own_at]])]
    rows = np.concatenate([rows[~of_slower[at]], *held])
    at = np.append(at[~of_slower[at]], own_at[of_slower[own_at]])
    figures["isolated"] = rows.astype(int), at
    figures["slower"] = {"sensor": sensor, "rate_hz": own["rate_hz"], "rows": own["rows"]}
    figures["clipped"] |= {name: own["clipped"][name] for name in axes}
    found, of_own = figures["faults"], own["faults"]
    if not found or not of_own:
        return figures
    for key in BY_CHANNEL:
        found[key] |= {name: of_own[key][name] for name in axes}
    for quantity, names in QUANTITIES.items():
        if names == axes:
            found["rows_a_value"][quantity] = of_own["rows_a_value"][quantity]
    silent = [name for name in found["silent_at_rest"] if name not in axes]
    found["silent_at_rest"] = silent + [n for n in of_own["silent_at_rest"] if n in axes]
    return figures
