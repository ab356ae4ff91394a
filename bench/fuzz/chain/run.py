"""Cases of the chain, each in a process of its own, within limits."""

import importlib
import os
import pkgutil
import re
import resource
import sys
import tempfile
import warnings
from pathlib import Path

import pyarrow as pa

import imuloop
from bench.fuzz.chain import recordings
from bench.fuzz.chain.cases import make
from bench.fuzz.chain.judge import judge, origin
from bench.fuzz.processes import MEMORY, limit_memory, scratch, shared_out

# of a case: s of processor time, and of a clock, for one that waits for ever
SECONDS, LONGEST = 60, 900
# what is no clear line on the terminal
UNCLEAR = re.compile(r"Traceback|Warning: ")
ABOVE = re.compile(r"^/.*/(lib/|site-packages/)")


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
    sys.dont_write_bytecode = True
    folder = Path(tempfile.mkdtemp(dir=folder))
    terminal = folder / "terminal"
    with open(terminal, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    # the chain logs them
    warnings.simplefilter("default")
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    limit_memory()
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
