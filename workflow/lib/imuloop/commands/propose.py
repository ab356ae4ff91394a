"""``imuloop propose``: an effect file of a formula that was found in a device."""

from pathlib import Path

from imuloop.commands.lines import say
from imuloop.core.files import read_json, refuse_overwriting
from imuloop.discover.propose import proposed

EXAMPLE = """example:
  imuloop propose results/my_imu --name frame_twist -o workflow/lib/imuloop/effects/frame_twist.py

Writes a complete effect: class, equation, units, derivative, limit; and a test beside it, named
test_NAME.py. Put the file into effects/ and the test into tests/diagnose/, then say in both what
causes it: docs/adding_an_effect.md."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "propose", help="write an effect file of a formula that was found", epilog=EXAMPLE, **how
    )
    command.add_argument("device", type=Path, help="folder of the device's results")
    command.add_argument("--name", default="found_effect", help="name of the effect")
    command.add_argument("-o", "--output", type=Path, help="file to write; NAME.py without")
    command.set_defaults(run=run)


def run(arguments):
    """Write the effect and its test."""
    text, test = proposed(read_json(arguments.device / "diagnosis.json"), arguments.name)
    output = arguments.output or Path(f"{arguments.name}.py")
    beside = output.with_name(f"test_{arguments.name}.py")
    refuse_overwriting([output, beside], [arguments.device / "diagnosis.json"])
    output.parent.mkdir(parents=True, exist_ok=True)
    for path, content in ((output, text), (beside, test)):
        path.write_text(content, encoding="utf-8")
    say(f"wrote {output} and {beside}")
