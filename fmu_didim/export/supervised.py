"""Runs a command and ends it, with all that it has started, when the process that asked for it ends.

A file that is run by its path; it imports nothing of the package. The process that starts it holds the other end of its
standard input and makes it the leader of a group. That end closes however the process ends, also where it is killed.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading


def _end_with_input(process: "subprocess.Popen[bytes]") -> None:
    sys.stdin.buffer.read()
    if hasattr(os, "killpg"):
        os.killpg(os.getpgid(0), signal.SIGKILL)  # this process, too
    with contextlib.suppress(OSError):  # Windows, which ends a process without those that it has started
        command = ["taskkill", "/T", "/F", "/PID", str(process.pid)]
        subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    with contextlib.suppress(OSError):
        process.kill()


def main() -> int:
    """Arguments: the command."""
    try:
        process = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    except OSError as error:
        sys.stderr.write(f"{error}\n")
        return 127
    threading.Thread(target=_end_with_input, args=(process,), daemon=True).start()
    return process.wait()


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code if code >= 0 else 128 - code)
