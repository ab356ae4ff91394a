"""``imuloop sensors``: list the sensors whose data sheet is known.

For example:
  imuloop sensors
  imuloop sensors icm42688p
"""

from imuloop.commands.lines import aligned, say
from imuloop.report.units import MILLIRADIAN, PERCENT, QUANTITIES, data_sheet
from imuloop.sensors import PARTS, find_sensor, sensor_names


def add(command):
    """Add the arguments of ``imuloop sensors`` to `command`, its argparse parser."""
    command.add_argument("name", nargs="?", help="one of them, for its figures")


def run(arguments):
    """Print the table of all sensors, or the figures of one sensor if the user names it.

    `arguments` are those that `add` declares, parsed.
    """
    name = arguments.name
    say(*(sheet_lines(find_sensor(name)) if name else map(listing_line, sensor_names())))


def listing_line(name):
    """Return the line of text for a sensor in the list: key, manufacturer, evidence and ranges.

    The evidence is the kind of document that has the figures, such as a data sheet. `name` is the
    key of the sensor.
    """
    sheet = find_sensor(name)
    both = [figures for figures in (sheet.accelerometer, sheet.gyroscope) if figures]
    ranges = ["/".join(r.name.partition(" ")[0] for r in figures.ranges) for figures in both]
    units = [figures.ranges[0].name.partition(" ")[2] for figures in both]
    spans = ", ".join(map(" ".join, zip(ranges, units, strict=True)))
    return f"{sheet.key:<12}{sheet.manufacturer:<20}{both[0].evidence:<12}{spans}"


def sheet_lines(sheet):
    """Return the figures of a sensor as lines of text, a list; `sheet` is its `DataSheet`."""
    lines = [f"{sheet.label}, {sheet.manufacturer}"]
    for quantity, sensor in PARTS.items():
        if not (figures := getattr(sheet, sensor)):
            continue
        si = {"acceleration": "m/s^2", "angular_rate": "rad/s"}[quantity]
        white, std = QUANTITIES[sensor]["N"], figures.tolerance
        lines.append(f"{sensor}: {figures.evidence}, {figures.source}")
        rows = [("range", f"{si} per count", f"white noise, {white.unit}")]
        for option in figures.ranges:
            rows.append((option.name, f"{option.scale:.6g}", white.size(option.noise_density)))
        lines += aligned(rows)
        prior = (
            f"scale factor {PERCENT.text(std.scale_factor)}",
            f"misalignment {MILLIRADIAN.text(std.misalignment)}",
            f"bias {data_sheet(si).text(std.bias)}",
        )
        lines.append(f"  standard deviations of the prior: {', '.join(prior)}")
    return lines
