"""What a rig draws for itself."""

import numpy as np
import pytest

from ccr_host.link.transport import parse_device_uri
from ccr_host.run.open_rig import session_number


@pytest.mark.parametrize("device", ["emulator:", "simavr:"])
def test_the_session_with_a_board_of_this_process_repeats_with_the_seed(device) -> None:
    numbers = {
        session_number(parse_device_uri(device), np.random.SeedSequence(7)) for _ in range(5)
    }
    assert len(numbers) == 1


@pytest.mark.parametrize("device", ["serial:/dev/ttyACM0", "tcp://127.0.0.1:5025"])
def test_hosts_of_a_board_elsewhere_do_not_share_a_session(device) -> None:
    numbers = {
        session_number(parse_device_uri(device), np.random.SeedSequence(7)) for _ in range(5)
    }
    assert len(numbers) > 1
    assert all(1 <= number < 1 << 16 for number in numbers)
