"""Executors: compute independent cases, with the interface of `concurrent.futures`.

They are processes of this machine, or the workers of a Dask cluster at an address (extra `dask`). One worker computes a whole
case, so its result is the same on every worker.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from clutch_hil.bench.arguments import take_whole
from protocols.errors import InputError

_TRIES = 3  # of a case whose worker died
_MOST_WORKERS = 256
_NAME_LENGTH = 200  # characters of a case in an error message

C = TypeVar("C")
R = TypeVar("R")


@contextmanager
def executor(workers: int | None = None, address: str | None = None) -> Iterator[Executor]:
    """Open `workers` processes, one per CPU if None, or the Dask cluster at `address`.

    An exception in the block ends the processes at once, because a case may take minutes; the cluster starts no further case.
    Raises InputError.
    """
    if address is not None:
        if workers is not None:
            raise InputError(
                f"workers = {workers} and a cluster at {address} were both given; a cluster has its own workers"
            )
        try:
            client = _import_dask(address).Client(address, timeout=10)
        except (OSError, ValueError, TypeError) as error:  # TypeError: no address at all, or tls without certificates
            raise InputError(f"no Dask scheduler answers at {address}: {error}") from None
        with client:
            cluster = client.get_executor(pure=False)
            try:
                yield cluster
            except BaseException:
                cluster.shutdown(wait=False)  # otherwise all waiting cases would be computed first
                raise
            cluster.shutdown()
        return
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    count = take_whole("workers", count, 1, _MOST_WORKERS)
    others = set(active_children())
    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        for process in set(active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def compute(
    function: Callable[[C], R], cases: Sequence[C], workers: int | None = None, address: str | None = None
) -> Iterator[tuple[int, R]]:
    """Yield (index, result) of every case as it becomes ready. Cases of a worker that died are repeated at most twice.

    Raises what `function` raises, and InputError, also where workers die three times or the cluster is lost.
    """
    left = dict(enumerate(cases))
    killed: Any = _import_dask(address).KilledWorker if address is not None else ()
    for _ in range(_TRIES):
        try:
            with executor(workers, address) as pool:
                futures = {pool.submit(function, case): index for index, case in left.items()}
                for future in as_completed(futures):
                    index = futures[future]
                    try:
                        result = future.result()
                    except killed:
                        name = f"{left[index]!s:.{_NAME_LENGTH}}"
                        raise InputError(f"case {name} killed every worker that computed it at {address}") from None
                    except CancelledError:
                        raise InputError(
                            f"the cluster at {address} is gone; {len(left)} of {len(cases)} cases are not computed"
                        ) from None
                    del left[index]
                    yield index, result
        except BrokenExecutor:
            continue
        return
    script = (
        ""
        if len(left) < len(cases)
        else (
            '; none was started: worker processes load the script, so call this below `if __name__ == "__main__":`, in a file'
        )
    )
    raise InputError(f"workers died {_TRIES} times; {len(left)} of {len(cases)} cases are not computed{script}")


def _end_with_parent() -> None:
    """End this worker when its parent is gone: a worker of a parent that was killed would wait for a case for ever."""

    def wait() -> None:
        if parent := parent_process():
            parent.join()
            os._exit(1)

    Thread(target=wait, daemon=True).start()


def _import_dask(address: str) -> Any:
    """Import the module `distributed`, which only a cluster needs. Raises InputError where it is not installed."""
    try:
        return import_module("distributed")
    except ImportError:
        raise InputError(f"the cluster at {address} needs Dask: pip install 'clutch-hil[dask]'") from None
