"""Memory used by the firmware on the UNO, measured on the binary that the other tests run."""

import re
import subprocess

from tests.conformance.firmware_build import firmware_elf

FLASH_BYTES = 13 * 1024 + 512
STATIC_RAM_BYTES = 1024


def test_flash_and_static_ram_stay_within_what_is_set_aside() -> None:
    text, data, bss = _sizes()
    assert text + data <= FLASH_BYTES
    assert data + bss <= STATIC_RAM_BYTES


def test_the_binary_has_no_heap_and_no_floating_point() -> None:
    names = _run("avr-nm", str(firmware_elf()))
    assert not re.search(
        r" (malloc|free|_Znwj|_ZdlPv|__addsf3|__mulsf3|__divsf3|__muldi3)$", names, re.M
    )
    assert re.search(r" main$", names, re.M)


def _sizes() -> tuple[int, ...]:
    return tuple(map(int, _run("avr-size", str(firmware_elf())).splitlines()[1].split()[:3]))


def _run(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
