"""Tasks on a running Dask cluster; a cluster that cannot be used is rejected before any work."""

from __future__ import annotations

import hashlib
import pickle
import secrets
import socket
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from softness_bayes.base.errors import InputError, WorkersLostError
from softness_bayes.base.files.outputs import require_directory
from softness_bayes.base.files.records import parse_json
from softness_bayes.base.files.whole import write_whole
from softness_bayes.checking.provenance import VERSION, versions

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")

TIMEOUT = 10.0
"""Time [s] within which a scheduler must answer."""

JOINING = 5.0
"""Time [s] to wait for the first worker, which may have been started together with this process."""

SCHEDULER = "at the scheduler"
"""Key of the scheduler's own report."""


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
        """True if tasks can write to the directory of this process; otherwise they return their files."""
        self._client, self._executor, self._versions = client, client.get_executor(pure=False), versions()

    def share(self, value: Any) -> Any:
        """Return the cluster's handle for a value; a task that gets the handle receives the value."""
        content = pickle.dumps(value)
        digest = hashlib.sha256(content).hexdigest()
        return self._client.submit(pickle.loads, content, key=f"softness-bayes-{digest}")

    def submit(self, work: Callable[..., Result], /, *task: Any, **named: Any) -> Future[Result]:
        """Submit a task."""
        future: Future[Result] = self._executor.submit(_on_worker, self._versions, work, *task, **named)
        return future

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
    WorkersLostError
        Inside the ``with`` block, if the workers of a task were killed repeatedly or the scheduler ended.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm import CommClosedError
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise InputError("--dask needs Dask: pip install 'softness-bayes[dask]'") from None
    address = scheduler
    if "://" not in scheduler and not Path(scheduler).is_file():
        raise InputError(
            f"{scheduler}: no such scheduler file; expected one, or an address such as tcp://10.0.0.1:8786"
        )
    try:
        if "://" not in scheduler:
            address = str(parse_json(Path(scheduler).read_text(encoding="utf-8"))["address"])
        _knock(address)
        with warnings.catch_warnings():
            # Dask's warning of other versions: they are refused, each by name
            warnings.simplefilter("ignore", VersionMismatchWarning)
            client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, KeyError, TypeError, ImportError, RuntimeError) as error:
        why = next(iter(str(error).splitlines()), type(error).__name__)
        raise InputError(
            f"{scheduler}: no scheduler answers there ({why}); 'dask scheduler' starts one and prints its address"
        ) from None
    with client:
        found = reports(client, directory)
        require_workers(scheduler, found)
        try:
            yield Cluster(client, not strangers(found))
        except KilledWorker as error:
            raise WorkersLostError(f"workers of the cluster died repeatedly at the same task: {error}") from None
        except (CancelledError, CommClosedError) as error:
            raise WorkersLostError(f"the cluster was lost ({error or 'its scheduler ended'})") from None


def strangers(found: Mapping[str, Worker | BaseException]) -> list[str]:
    """Return the addresses of the workers that do not see the client's directory."""
    return [address for address, one in found.items() if isinstance(one, Worker) and not one.shares]


def require_workers(scheduler: str, found: Mapping[str, Worker | BaseException], most: int = 3) -> None:
    """Raise an error for a cluster whose workers cannot be used.

    Parameters
    ----------
    scheduler
        Its name, for messages.
    found
        Report of each worker by its address, or the error raised instead.
    most
        Largest number of workers in the message.

    Raises
    ------
    InputError
        Naming the workers and the reason.
    """
    if not found:
        raise InputError(
            f"{scheduler}: the scheduler has no workers; start some, for example with 'dask worker --nthreads 1'"
        )
    own, faults = versions(), []
    for address, one in found.items():
        who = "the scheduler itself" if address == SCHEDULER else f"worker {address}"
        if isinstance(one, BaseException):
            faults.append(f"{who} cannot run softness-bayes ({one})")
        elif differ := [name for name in own if one.versions.get(name) != own[name]]:
            each = (f"{name.removeprefix(VERSION)} {one.versions.get(name)} (here {own[name]})" for name in differ)
            faults.append(f"{who} has {', '.join(each)}")
        elif one.threads != 1:
            remedy = "start it with --nthreads 1, and more workers with --nworkers"
            faults.append(f"{who} has {one.threads} threads; {remedy}")
    if faults:
        more = f"; and {len(faults) - most} more" if len(faults) > most else ""
        raise InputError(f"{scheduler}: {'; '.join(faults[:most])}{more}")


def _knock(address: str) -> None:
    """Raise an error at once if nothing listens at an address.

    A Dask client that fails to connect tries again in its destructor, whose traceback cannot be caught.
    """
    from distributed.comm.addressing import parse_address, parse_host_port

    kind, place = parse_address(address)
    if kind not in ("tcp", "tls", "ws", "wss"):  # those with a host and a port
        raise ValueError("expected an address that begins with one of tcp://, tls://, ws://, wss://")
    with socket.create_connection(parse_host_port(place), TIMEOUT):
        pass


def reports(client: Client, directory: Path | None) -> dict[str, Worker | BaseException]:
    """Return the report of every worker, or the error raised instead; those that died meanwhile are left out.

    Whether workers see the directory is tested by a file in it, or in the folder in which it will be made.
    """
    token, path = secrets.token_hex(8), None
    if directory is not None:
        require_directory(directory)
        path = next(place for place in (directory, *directory.parents) if place.is_dir()).resolve() / f".shared-{token}"
        write_whole(path, token.encode("ascii"))
    try:
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=JOINING)
        answers = client.run(_report, None if path is None else str(path), token, on_error="return")
    finally:
        if path is not None:
            path.unlink(missing_ok=True)
    threads = client.nthreads()
    found: dict[str, Worker | BaseException] = {
        address: one if isinstance(one, BaseException) else Worker(one[0], one[1], threads.get(address, 1))
        for address, one in answers.items()
        if not isinstance(one, OSError)  # a worker that cannot be reached gets no tasks until it returns
    }
    if found:  # the scheduler, which also unpickles the tasks, needs no directory and runs none
        try:
            found[SCHEDULER] = Worker(client.run_on_scheduler(versions), True, 1)
        except Exception as error:
            found[SCHEDULER] = error
    return found


def _report(path: str | None, token: str) -> tuple[dict[str, str], bool]:
    """Return the versions of a worker, and whether it sees the file of the client, if there is one."""
    seen = token
    if path is not None:
        try:
            seen = Path(path).read_text(encoding="ascii")
        except OSError:
            seen = ""
    return versions(), seen == token


def _on_worker(expected: Mapping[str, str], work: Callable[..., Result], *task: Any, **named: Any) -> Result:
    """Run a task on a worker after checking its versions, because it may have joined after the first check.

    Dask is set to a single thread; otherwise xarray would request a lock from the scheduler to write a file in memory.
    """
    import dask

    if versions() != expected:
        raise InputError(f"a worker has other versions than this process: {versions()}, expected {expected}")
    with dask.config.set(scheduler="synchronous"):
        return work(*task, **named)
