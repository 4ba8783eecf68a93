"""A `gsid studio` in a process of its own."""

import re
import signal
import subprocess
import sys

STEP_MS = 180_000  # of the longest step, on a loaded computer


class Studio:
    """A running `gsid studio`, with the study NAME in a folder."""

    def __init__(self, folder, name="study", port=0):
        self.folder, self.name = folder, name
        command = [sys.executable, "-m", "gsid.cli.main", "studio", "--no-browser", "--folder", name]
        self.process = subprocess.Popen(
            [*command, "--port", str(port)], cwd=folder, stdout=subprocess.PIPE, text=True
        )
        self.address = re.search(r"http://\S+", self.process.stdout.readline()).group()
        self.port = int(re.search(r":(\d+)/", self.address).group(1))

    def successor(self):
        """Another server on the port of this one, which is stopped."""
        return Studio(self.folder, self.name, self.port)

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(timeout=30)
