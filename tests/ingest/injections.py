"""The table of injections, of values, units and clocks."""

from ingest.injected_clocks import CLOCKS
from ingest.injected_units import UNITS
from ingest.injected_values import VALUES

INJECTIONS = [*VALUES, *UNITS, *CLOCKS]
