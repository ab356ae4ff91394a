"""Harmed stretches of recordings through the whole chain: is every result of each sound?

From the repository, its library on the path: ``python -m bench.fuzz.chain --cases 3000``. Each case
is made of its number alone; ``--case N`` runs one again, with its traceback, and ``--keep FOLDER``
leaves its log and results there. A case has 60 s of processor time and 1 GB. It is sound if all
result files are there, fit their schemas in workflow/schemas and hold nothing but numbers, and the
report is well-formed.
"""

import argparse
import importlib
import pkgutil
import re
import resource
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import imuloop
from bench.fuzz.chain import recordings
from bench.fuzz.chain.cases import make
from bench.fuzz.chain.judge import judge, origin
from bench.fuzz.processes import MEMORY, confine, scratch, shared_out

# of a case: s of processor time, and of a clock, for one that waits for ever
SECONDS, LONGEST = 60, 900
# what is no clear line on the terminal
UNCLEAR = re.compile(r"Traceback|Warning: ")
ABOVE = re.compile(r"^/.*/(lib/|site-packages/)")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--case", type=int, help="run this one alone, without limits")
    parser.add_argument("--keep", type=Path, help="with --case: folder for its log and results")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = options.keep or Path(folder)
        if options.case is not None:
            folder.mkdir(parents=True, exist_ok=True)
            case = make(options.case, folder)
            print(*case.words, sep="\n", flush=True)
            end, faults = judge(case, folder / "results")
            print(end, *faults, sep="\n  ! ")
            return bool(faults)
        ends, faulty = Counter(), 0
        numbers = range(options.first, options.first + options.cases)
        for number, end, faults in fuzz(numbers, options.workers):
            ends[end] += 1
            if faults:
                faulty += 1
                print(f"case {number}, {end}", *make(number, folder).words, sep="\n  ")
                print(*(f"  ! {fault}" for fault in faults), sep="\n", flush=True)
    print(", ".join(f"{n} {end}" for end, n in sorted(ends.items())))
    print(f"{options.cases} cases, {faulty} faulty")
    return bool(faulty)


def fuzz(numbers, workers=2):
    """Run cases, that many at once; yield number, end and list of faults of each."""
    # each process then has library and recordings without reading
    for module in pkgutil.walk_packages(imuloop.__path__, "imuloop."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in (name for family in recordings.FAMILIES for name in family):
        try:
            recordings.recording(name)
        except recordings.NotAtHand as lacking:
            print(f"no case of {name}: {lacking}", file=sys.stderr)
    with scratch() as folder:
        for number, end, faults in shared_out(numbers, workers, LONGEST, serve, folder, batch=1):
            if faults == ["the process ended with -24"]:
                faults = [f"crash: more than {SECONDS} s of processor time"]
            yield number, end, faults


def serve(pipe, numbers, folder):
    """Answer one case, within limits of memory and processor time."""
    folder = Path(tempfile.mkdtemp(dir=folder))
    terminal = folder / "terminal"
    confine(terminal)
    # the chain logs them
    warnings.simplefilter("default")
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    try:
        case = make(*numbers, folder)
        end, faults = judge(case, folder / "results")
    except recordings.NotAtHand:
        end, faults = "not at hand", []
    except MemoryError as error:
        end, faults = "memory", [f"more than {MEMORY >> 30} GB: {origin(error)}"]
    except Exception as error:
        end, faults = "traceback", [origin(error)]
    sys.stdout.flush()
    sys.stderr.flush()
    lines = terminal.read_text(errors="replace").splitlines()
    # the line below a warning is the code that it comes from
    unclear = (f"terminal: {ABOVE.sub('', line)}" for line in lines if UNCLEAR.search(line))
    pipe.send((end, [*faults, *dict.fromkeys(unclear)]))


if __name__ == "__main__":
    sys.exit(main())
