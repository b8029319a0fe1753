import subprocess
import sys

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.record.folder import ResultFolder

HOLDS_IT = """
import sys
from pathlib import Path
from ccr_host.record.folder import ResultFolder
with ResultFolder(Path(sys.argv[1]), "run"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="folders are not locked there")
@pytest.mark.parametrize("way", ["ends", "is killed"])
def test_a_folder_to_which_another_process_writes_is_refused_until_it(tmp_path, way):
    command = [sys.executable, "-c", HOLDS_IT, str(tmp_path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(ConfigError, match="another run writes to it"):
            ResultFolder(tmp_path, "run")
        other.stdin.close() if way == "ends" else other.kill()
    with ResultFolder(tmp_path, "run"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_folder_can_be_used_again_by_the_same_process(tmp_path):
    for _ in range(2):
        with ResultFolder(tmp_path, "run") as folder:
            folder.keep_json("run.json", {})
    assert (tmp_path / "run.json").exists()
