"""Work on the parts of a log in threads, with results in the order of the parts."""

from collections import deque
from concurrent.futures import ThreadPoolExecutor


def in_order(function, items, threads=1):
    """Give `function` of each item, in order, whatever the number of threads.

    Parameters
    ----------
    function : callable
        Of one item; with several threads it must leave what others see alone.
    items : iterable
        Taken in the caller's thread, few more than results were given.
    threads : int
        How many items are worked on at once; none but the caller's thread if 1.
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
