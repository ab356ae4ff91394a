"""docs/benchmarks.md: ``python -m bench.document PART …`` measures and writes a part's section.

Sections of other parts stay as they are; each names its own commit, machine and command.
"""

import argparse
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

from bench.commit import commit

DOCUMENT = Path(__file__).parents[1] / "docs/benchmarks.md"
HEAD = """# Benchmarks

Written by the commands that each section names, never by hand. Seconds are processor time of one
thread, or "wall"; the best of rounds in which the contenders take turns, each in its own process.
Packages are those of `requirements.lock`."""
# by name: title, module and options that measure, the target of the Makefile
PARTS = {
    "peers": ("Beside other packages", "bench.peers", "make bench"),
    "a-day-200": ("24 h at 200 Hz", "bench.a_day --rate 200", "make a-day RATE=200"),
    "a-day-1000": ("24 h at 1 kHz", "bench.a_day --rate 1000", "make a-day RATE=1000"),
    "factory": ("A factory's devices", "bench.factory", "make factory"),
}


def machine():
    """Return the machine in a line; neither its name nor a path."""
    models = re.findall(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, {memory:.0f} GB, "
        f"{platform.system()}, Python {platform.python_version()}"
    )


def measure(part, options):
    """Run a part and return its section."""
    title, command, target = PARTS[part]
    print(f"{title} …", file=sys.stderr, flush=True)
    done = subprocess.run(
        [sys.executable, "-m", *command.split(), *options],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    text = done.stdout.strip()
    if done.returncode:
        text += f"\n\nexit status {done.returncode}"
    shown = f"`{target}`" + (f" with `{' '.join(options)}`" if options else "")
    return f"## {title}\n\n{shown}, commit {commit()}. {machine()}.\n\n{text}\n"


def write(sections):
    """Put sections, by part, in the place of those that the document has; in the order of PARTS."""
    found = {}
    if DOCUMENT.exists():
        for section in re.split(r"^(?=## )", DOCUMENT.read_text(), flags=re.M)[1:]:
            title = section.splitlines()[0].removeprefix("## ")
            found |= {part: section.strip() for part, each in PARTS.items() if each[0] == title}
    found |= {part: section.strip() for part, section in sections.items()}
    texts = [HEAD, *(found[part] for part in PARTS if part in found)]
    DOCUMENT.write_text("\n\n".join(texts) + "\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(prog="python -m bench.document", description=__doc__)
    parser.add_argument("parts", nargs="+", choices=PARTS)
    parser.add_argument("--options", default="", help="for the command of the part")
    options = parser.parse_args()
    for part in options.parts:
        write({part: measure(part, options.options.split())})


if __name__ == "__main__":
    main()
