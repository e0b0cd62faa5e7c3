"""Better parameters for a robot: a small search, verified on scenarios that it has not seen."""

import subprocess
import sys

command = ["tune", "--params", "turtlebot", "--suite", "narrow", "--count", "2", "--trials", "2", "--out", "tuned"]
if __name__ == "__main__":
    # the interface of tuning is the command line: it is resumable, and writes parameter files and a report
    sys.exit(subprocess.run([sys.executable, "-m", "navstack", *command]).returncode)
