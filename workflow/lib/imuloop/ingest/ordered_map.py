"""Work on the parts of a log in threads, with results in the order of the parts."""

from collections import deque
from concurrent.futures import ThreadPoolExecutor


def ordered_map(function, items, threads=1):
    """Give `function` of each item in order; with several threads few items are taken ahead.

    `ThreadPoolExecutor.map` would take in all items, a whole log, at once.
    """
    if threads == 1:
        yield from map(function, items)
        return
    waiting, fault = deque(), None
    with ThreadPoolExecutor(threads) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > threads:
                    yield waiting.popleft().result()
        except Exception as error:
            # comes after what was given before it
            fault = error
        while waiting:
            yield waiting.popleft().result()
    if fault:
        raise fault
