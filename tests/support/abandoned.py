"""What killed writers leave: a part of a file in a folder."""

import os
import subprocess
import sys
import time

from jounce.core import temporary_files


def abandoned_part(folder, process=None, age=0.0):
    """A part in a folder, of a process that is gone unless one is given."""
    if process is None:
        gone = subprocess.Popen([sys.executable, "-c", ""])
        gone.wait()
        process = gone.pid
    path = temporary_files.temporary_path(folder)
    path = path.with_name(path.name.replace(f"-{os.getpid()}-", f"-{process}-"))
    path.write_text("half of")
    os.utime(path, (time.time() - age,) * 2)
    return path
