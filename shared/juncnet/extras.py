"""How to install what an extra of this distribution brings."""

import shlex
import sys

from juncnet.assets import CHECKOUT


def install_command(extra: str) -> str:
    """Return the command that installs an extra beside this program, to be typed as it is.

    By way of the checkout, with its constraints: the name alone would ask a package index, where
    it may be somebody else's, and would get the largest builds of what it needs.
    """
    python, constraints = sys.executable or "python3", CHECKOUT / "deploy" / "constraints.txt"
    if constraints.is_file():
        source = ["-c", str(constraints), "-e", f"{CHECKOUT}[{extra}]"]
    else:
        source = ["-c", "deploy/constraints.txt", f".[{extra}]"]
    command = shlex.join([python, "-m", "pip", "install", *source])
    return command if constraints.is_file() else f"{command} (in a checkout)"
