"""Cases of the chain, each in a process of its own, within limits."""

import importlib
import os
import pkgutil
import re
import resource
import shutil
import sys
import warnings
from pathlib import Path

import pyarrow as pa

import imuloop
from bench.fuzz.chain.cases import make
from bench.fuzz.chain.judge import judge, told
from bench.fuzz.chain.recordings import FAMILIES, NotAtHand, recording
from bench.fuzz.run import scratch, shared_out

# of a case: s of processor time, bytes; s of a clock, for one that waits for ever
SECONDS, MEMORY = 60, 1 << 30
LONGEST = 900
# what is no clear line on the terminal
UNCLEAR = re.compile(r"Traceback|Warning: ")
ABOVE = re.compile(r"^/.*/(lib/|site-packages/)")
TOO_LONG = f"crash: more than {SECONDS} s of processor time"


def fuzz(numbers, workers=2):
    """Run cases; yield number, end and list of faults of each.

    Parameters
    ----------
    numbers : iterable of int
        The cases.
    workers : int
        Processes at once.
    """
    # each process then has library and recordings without reading
    for module in pkgutil.walk_packages(imuloop.__path__, "imuloop."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in (name for family in FAMILIES for name in family):
        try:
            recording(name)
        except NotAtHand as lacking:
            print(f"{lacking} is not at hand: no case of it", file=sys.stderr)
    with scratch() as folder:
        for number, _, end, fault in shared_out(
            numbers, workers, folder, LONGEST, serve, once=True
        ):
            if "ended with -24" in (fault or ""):
                fault = TOO_LONG
            yield number, end, [fault] if isinstance(fault, str) else fault or []


def serve(pipe, folder, _):
    """Answer one case, within limits of memory and processor time."""
    sys.dont_write_bytecode = True
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    said = folder / "said"
    with open(said, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    # the chain logs them
    warnings.simplefilter("default")
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    number = pipe.recv()
    try:
        case = make(number, folder)
        end, faults = judge(case, folder / "results")
    except NotAtHand:
        end, faults = "not at hand", []
    except MemoryError as error:
        end, faults = "memory", [f"more than {MEMORY >> 30} GB: {told(error)}"]
    except Exception as error:
        end, faults = "traceback", [told(error)]
    sys.stdout.flush()
    sys.stderr.flush()
    lines = said.read_text(errors="replace").splitlines()
    # the line below a warning is the code that it comes from
    faults += dict.fromkeys(
        f"terminal: {ABOVE.sub('', each)}" for each in lines if UNCLEAR.search(each)
    )
    pipe.send((end, faults))
