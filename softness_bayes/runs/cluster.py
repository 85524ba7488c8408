"""Executor on an existing Dask cluster whose workers have the same versions."""

from __future__ import annotations

import hashlib
import pickle
import secrets
import socket
import warnings
import weakref
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from softness_bayes.errors import InputError, WorkersLostError
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.outputs import require_directory
from softness_bayes.files.whole import write_whole
from softness_bayes.provenance import VERSION, versions

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")

INSTALL = "pip install 'softness-bayes[dask]'"
"""Command that installs the client of a cluster."""

TIMEOUT = 10.0
"""Time [s] within which a scheduler must answer."""

JOINING = 5.0
"""Time [s] to wait for the first worker, which may have been started together with this process."""

SCHEDULER = "at the scheduler"
"""Key of the scheduler's own report."""

_NAMED = 3  # workers in a message
_KINDS = ("tcp", "tls", "ws", "wss")  # of addresses with a host and a port


class Worker(NamedTuple):
    """State of one worker, as reported by it."""

    versions: Mapping[str, str]
    shares: bool
    """True if it sees the client's directory."""
    threads: int


class Cluster(Executor):
    """Executor that runs tasks on a Dask cluster and sends each shared value to the scheduler only once.

    The scheduler reassigns the task of a killed worker to another one. Use `cluster`, which connects and checks.

    Parameters
    ----------
    client
        A client of the cluster.
    shares_files
        Whether all workers see the directory in which this process writes.
    """

    def __init__(self, client: Client, shares_files: bool = True) -> None:
        self.shares_files = shares_files
        """Whether tasks can write to the directory of this process; otherwise they return their files."""
        self._client, self._executor, self._versions = client, client.get_executor(pure=False), versions()

    def share(self, value: Any) -> Any:
        """Return the cluster's handle for a value; a task that gets the handle receives the value."""
        content = pickle.dumps(value)
        digest = hashlib.sha256(content).hexdigest()
        return self._client.submit(pickle.loads, content, key=f"softness-bayes-{digest}")

    def submit(self, work: Callable[..., Result], /, *task: Any, **named: Any) -> Future[Result]:
        """Submit a task; its future fails with `WorkersLostError` if its workers were killed repeatedly."""
        found: Future[Result] = Future()
        running = self._executor.submit(_alike, self._versions, work, *task, **named)
        pending = weakref.ref(running)  # the other way is strong: a cycle would keep every task until a collection
        found.add_done_callback(lambda asked: _give_up(pending) if asked.cancelled() else None)
        running.add_done_callback(lambda done: _pass_on(done, found))
        return found

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect from the cluster, which keeps running."""
        self._executor.shutdown(wait=wait and not cancel_futures)


@contextmanager
def cluster(scheduler: str, directory: Path | None = None) -> Iterator[Cluster]:
    """Connect to a running cluster.

    Parameters
    ----------
    scheduler
        Address of its scheduler, such as ``tcp://10.0.0.1:8786``, or path of its scheduler file.
    directory
        Directory in which tasks write their files if all workers share it with this process (`Cluster.shares_files`);
        None if they write none.

    Raises
    ------
    InputError
        If Dask is not installed, there is no such scheduler, it has no workers, or these have other versions or more
        than one thread each.
    """
    with _client(scheduler) as client:
        missing = [path for path in (directory, *directory.parents) if not path.exists()] if directory else []
        try:
            found = _workers(client, directory)
            require_workers(scheduler, found)
        except InputError:
            for path in missing:  # made for the check alone
                with suppress(OSError):
                    path.rmdir()
            raise
        yield Cluster(client, directory is None or not strangers(found))


def strangers(found: Mapping[str, Worker | BaseException]) -> list[str]:
    """Return the addresses of the workers that do not see the client's directory."""
    return [address for address, one in found.items() if isinstance(one, Worker) and not one.shares]


def require_workers(scheduler: str, found: Mapping[str, Worker | BaseException]) -> None:
    """Raise an error for a cluster whose workers cannot be used.

    Parameters
    ----------
    scheduler
        Its name, for messages.
    found
        Report of each worker by its address, or the error raised instead.

    Raises
    ------
    InputError
        Naming the workers and the reason.
    """
    if not found:
        raise InputError(
            f"{scheduler}: the scheduler has no workers; start some, for example with 'dask worker --nthreads 1'"
        )
    own = versions()
    faults: dict[str, str] = {}
    for address, one in found.items():
        if isinstance(one, BaseException):
            faults[address] = f"cannot run softness-bayes ({one})"
        elif differ := [name for name in own if one.versions.get(name) != own[name]]:
            faults[address] = "has " + ", ".join(
                f"{name.removeprefix(VERSION)} {one.versions.get(name)} (here {own[name]})" for name in differ
            )
        elif one.threads != 1:
            faults[address] = f"has {one.threads} threads; start it with --nthreads 1, and more workers with --nworkers"
    if faults:
        said = [f"worker {address} {fault}" for address, fault in faults.items()]
        shown = "; ".join(said[:_NAMED]).replace(f"worker {SCHEDULER}", "the scheduler itself")
        more = f"; and {len(faults) - _NAMED} more" if len(faults) > _NAMED else ""
        raise InputError(f"{scheduler}: {shown}{more}")


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    try:
        from distributed import Client
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise InputError(f"--dask needs Dask: {INSTALL}") from None
    asked: dict[str, Any] = {"address": scheduler}
    if "://" not in scheduler:
        if not Path(scheduler).is_file():
            raise InputError(
                f"{scheduler}: no such scheduler file; expected one, or an address such as tcp://10.0.0.1:8786"
            )
        asked = {"scheduler_file": scheduler}
    try:
        _knock(_address(scheduler))
        with warnings.catch_warnings():
            # Dask's warning of other versions: they are refused, each by name
            warnings.simplefilter("ignore", VersionMismatchWarning)
            client = Client(**asked, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, KeyError, TypeError, ImportError, RuntimeError) as error:
        why = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(
            f"{scheduler}: no scheduler answers there ({why}); 'dask scheduler' starts one and prints its address"
        ) from None
    with client:
        yield client


def _address(scheduler: str) -> str:
    """Return the address of a scheduler, which may be the path of its file."""
    if "://" in scheduler:
        return scheduler
    return str(parse_json(Path(scheduler).read_text(encoding="utf-8"))["address"])


def _knock(address: str) -> None:
    """Raise an error at once if nothing listens at an address.

    A Dask client that fails to connect tries again in its destructor, whose traceback cannot be caught.
    """
    from distributed.comm.addressing import parse_address, parse_host_port

    kind, place = parse_address(address)
    if kind not in _KINDS:
        raise ValueError(f"expected an address that begins with one of {', '.join(f'{one}://' for one in _KINDS)}")
    with socket.create_connection(parse_host_port(place), TIMEOUT):
        pass


def _workers(client: Client, directory: Path | None) -> dict[str, Worker | BaseException]:
    """Return the report of every worker, or the error raised instead; those that died meanwhile are left out."""
    token, path = secrets.token_hex(8), None
    if directory is not None:
        require_directory(directory)
        directory.mkdir(parents=True, exist_ok=True)
        path = directory.resolve() / f".shared-{token}"
        write_whole(path, token.encode("ascii"))
    try:
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=JOINING)
        reports = client.run(_report, None if path is None else str(path), token, on_error="return")
        # a worker that cannot be reached gets no tasks; one that returns is checked with its first task
        reports = {address: one for address, one in reports.items() if not isinstance(one, OSError)}
        threads = client.nthreads()
        found: dict[str, Worker | BaseException] = {}
        if reports:  # the scheduler also unpickles the tasks
            found[SCHEDULER] = _of_the_scheduler(client)
        for address, one in reports.items():
            failed = isinstance(one, BaseException)
            found[address] = one if failed else Worker(one[0], one[1], threads.get(address, 1))
        return found
    finally:
        if path is not None:
            path.unlink(missing_ok=True)


def _of_the_scheduler(client: Client) -> Worker | BaseException:
    """Return the report of the scheduler, which needs no directory and runs no task, or its error."""
    try:
        return Worker(client.run_on_scheduler(versions), True, 1)
    except Exception as error:
        return error


def _report(path: str | None, token: str) -> tuple[dict[str, str], bool]:
    """Return the versions of a worker, and whether it can read a file."""
    seen = ""
    if path is not None:
        with suppress(OSError):
            seen = Path(path).read_text(encoding="ascii")
    return versions(), seen == token


def _alike(expected: Mapping[str, str], work: Callable[..., Result], *task: Any, **named: Any) -> Result:
    """Run a task on a worker after checking its versions, because it may have joined after the first check.

    Dask is set to a single thread; otherwise xarray would request a lock from the scheduler to write a file in memory.
    """
    import dask

    if versions() != expected:
        raise InputError(f"a worker has other versions than this process: {versions()}, expected {expected}")
    with dask.config.set(scheduler="synchronous"):
        return work(*task, **named)


def _give_up(pending: weakref.ref[Future[Any]]) -> None:
    """Cancel a task if it still exists."""
    if (running := pending()) is not None:
        running.cancel()


def _pass_on(done: Future[Result], found: Future[Result]) -> None:
    """Pass a task's result, or its error converted to an error of the toolkit, to another future."""
    from distributed import KilledWorker

    if not found.set_running_or_notify_cancel():
        return
    try:
        found.set_result(done.result())
    except KilledWorker as error:
        found.set_exception(WorkersLostError(f"workers of the cluster died repeatedly at the same task: {error}"))
    except (CancelledError, OSError) as error:
        found.set_exception(WorkersLostError(f"the cluster was lost ({error or 'its scheduler ended'})"))
    except BaseException as error:
        found.set_exception(error)
