"""Executors: where independent cases are computed, behind the interface of `concurrent.futures`.

Processes of this machine, or the workers of a Dask cluster at an address (extra `dask`). A case is computed whole in one place,
so the place changes no result.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from protocols.errors import InputError

_TRIES = 3  # of cases whose worker died
_MOST_WORKERS = 256


@contextmanager
def executor(workers: int | None = None, address: str | None = None) -> Iterator[Executor]:
    """`workers` processes, one for each CPU if None, or the Dask cluster at `address`. Raises InputError."""
    if address is not None:
        if workers is not None:
            raise InputError(f"workers = {workers} was given beside the cluster at {address}, which has its own")
        try:
            from distributed import Client
        except ImportError:
            raise InputError(f"the cluster at {address} needs Dask: pip install 'clutch-hil[dask]'") from None
        try:
            client = Client(address, timeout=10)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at {address}: {error}") from None
        with client, client.get_executor(pure=False) as cluster:
            yield cluster
        return
    count = workers if workers is not None else len(os.sched_getaffinity(0))
    if not 1 <= count <= _MOST_WORKERS:
        raise InputError(f"{count} workers are not possible; allowed are 1 to {_MOST_WORKERS}")
    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def computed(
    function: Callable[[Any], Any], cases: Sequence[Any], workers: int | None = None, address: str | None = None
) -> Iterator[tuple[int, Any]]:
    """(index, result) of every case as it comes. Cases of a worker that died are computed again, twice at most.

    Raises InputError, also where the workers keep dying, and what `function` raises.
    """
    left = dict(enumerate(cases))
    for _ in range(_TRIES):
        try:
            with executor(workers, address) as pool:
                futures = {pool.submit(function, case): index for index, case in left.items()}
                for future in as_completed(futures):
                    index = futures[future]
                    result = future.result()
                    del left[index]
                    yield index, result
        except BrokenExecutor:
            continue
        return
    raise InputError(f"workers died {_TRIES} times; {len(left)} of {len(cases)} cases are not computed")
