"""Other systems than the one that the tests run on: the package imports without what POSIX alone has."""

import subprocess
import sys

from support.modules import MODULES

ABSENT = ("fcntl", "grp", "pwd", "resource", "termios", "tty", "_posixshmem", "_posixsubprocess")
"""Modules of the standard library that Windows has not."""
NAMELESS = {
    "os": (
        *("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "WNOHANG", "chown", "fchmod", "fork", "forkpty"),
        *("getegid", "geteuid", "getgid", "getloadavg", "getpgid", "getuid", "killpg", "mkfifo", "nice", "posix_spawn"),
        *("pread", "pwrite", "sched_getaffinity", "set_blocking", "setsid", "statvfs", "sync", "uname", "wait4"),
    ),
    "signal": (
        *("SIGALRM", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGSTOP", "SIGUSR1", "alarm", "pthread_kill", "pthread_sigmask"),
        *("pause", "setitimer", "siginterrupt", "sigwait"),
    ),
}
"""What it lacks of others."""

PROGRAM = """
import importlib, os, signal, sys

OTHERS = {others!r}
for name in OTHERS:
    importlib.import_module(name)
for name in list(sys.modules):
    if name.partition(".")[0] == "softness_bayes":
        raise SystemExit(name)
sys.modules.update(dict.fromkeys({absent!r}))
for module, names in {nameless!r}.items():
    for name in names:
        vars(sys.modules[module]).pop(name, None)
for name in {modules!r}:
    importlib.import_module(f"softness_bayes.{{name}}")
"""
OTHERS = (
    *("arviz", "asyncio", "bokeh.embed", "bokeh.plotting", "click", "concurrent.futures.process", "corner", "emcee"),
    *("filelock", "h5netcdf", "h5py", "jinja2", "matplotlib.figure", "matplotlib.backends.backend_agg"),
    *("multiprocessing.resource_tracker", "pandas", "scipy.optimize", "scipy.stats", "subprocess", "tempfile"),
    *("threadpoolctl", "tqdm", "xarray"),
)
"""Libraries that answer for other systems themselves: imported before anything is taken away."""


def imported(modules):
    program = PROGRAM.format(others=OTHERS, absent=ABSENT, nameless=NAMELESS, modules=modules)
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)


def test_every_module_imports_without_what_posix_alone_has():
    done = imported(sorted(name for name in MODULES if name != "__main__"))
    assert done.returncode == 0, done.stderr
