"""Of two sensors with their own clocks: the quality of the slower one's own samples.

Values that rows hold would look like firmware that holds them, or like a filter, and a spike that
they hold like a step.
"""

import numpy as np

from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TIME
from imuloop.ingest import quality
from imuloop.ingest.increments import SENSORS as QUANTITIES

# faults that quality.json has by channel
BY_CHANNEL = ("failed_reads", "stuck", "spikes", "wraps", "clipped_at")


def measure(columns, sensor, raw_units, full_scale):
    """Return quality figures in which the slower sensor's channels are by its own samples.

    Under ``slower`` are the sensor, its rate and its rows. A spike of it is in all rows that hold
    it. Parameters are as in `quality.measure`.
    """
    figures, axes = quality.measure(columns, raw_units, full_scale), SENSORS[sensor]
    stamps = columns[OWN_TIME[sensor]]
    # the rows with a new sample
    first = np.flatnonzero(np.diff(stamps, prepend=-np.inf) > 0)
    own = {name: x[first] for name, x in columns.items()}
    own[TIME] = stamps[first] - stamps[first][:1].sum()
    own = quality.measure(own, raw_units, full_scale)
    of_slower = np.isin(CHANNELS, axes)
    rows, at = figures["isolated"]
    own_rows, own_at = own["isolated"]
    edges = np.append(first, figures["rows"])
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
