"""`deploy/test` needs no torch: what does is skipped, and everything else is collected."""

import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
COLLECT = """
import sys
sys.modules["torch"] = None
import pytest
raise SystemExit(pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", sys.argv[1]]))
"""


def test_all_tests_are_collected_where_torch_is_not_installed() -> None:
    command = [sys.executable, "-c", COLLECT, str(TESTS)]
    done = subprocess.run(command, cwd=TESTS.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
