"""The EEPROM as bytes: in memory, or kept in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Protocol

from ccr_host.errors import ConfigError
from ccr_host.link.messages import EEPROM_SIZE
from ccr_host.user_file import replacing

ERASED: Final = 0xFF


class Eeprom(Protocol):
    """What the board needs of its EEPROM."""

    def read(self, address: int, count: int) -> bytes:
        """Bytes from `address` on."""

    def write(self, address: int, value: int) -> None:
        """Write one byte; it may fail, so whoever writes reads back."""


class EepromImage:
    """EEPROM in memory.

    Args:
        content: its bytes; erased where it is left out.
        worn_out: addresses that no longer take what is written.
    """

    def __init__(
        self, content: bytes | None = None, worn_out: frozenset[int] = frozenset()
    ) -> None:
        self.content = bytearray(content or bytes([ERASED]) * EEPROM_SIZE)
        self.worn_out = worn_out

    def read(self, address: int, count: int) -> bytes:
        return bytes(self.content[address : address + count])

    def write(self, address: int, value: int) -> None:
        if address not in self.worn_out:
            self.content[address] = value


class EepromFile:
    """EEPROM kept in a file of its size, so that it survives the emulator.

    Raises:
        ConfigError: the file cannot be used.
    """

    def __init__(self, path: Path) -> None:
        try:
            if not path.exists():
                with replacing(path) as draft:
                    draft.write_bytes(bytes([ERASED]) * EEPROM_SIZE)
            self._file = path.open("r+b", buffering=0)
        except (OSError, ValueError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise ConfigError(
                f"EEPROM file {path}: {why}", "give a file that can be written"
            ) from None
        if path.stat().st_size != EEPROM_SIZE:
            self._file.close()
            raise ConfigError(
                f"EEPROM file {path}: not {EEPROM_SIZE} bytes long", "remove it or give another one"
            )

    def read(self, address: int, count: int) -> bytes:
        self._file.seek(address)
        return self._file.read(count)

    def write(self, address: int, value: int) -> None:
        self._file.seek(address)
        self._file.write(bytes([value]))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
