"""A board on a port, for all tests of a session: examined first, and finally restored."""

from __future__ import annotations

from dataclasses import dataclass

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import DeviceError
from ccr_host.link import messages as m
from ccr_host.link.board_config import BoardConfig
from ccr_host.link.device_errors import SpecMismatchError
from ccr_host.link.transport import parse_device_uri
from tests.conformance.host import SESSION, Host
from tests.conformance.port_device import PortDevice


@dataclass(frozen=True)
class EepromContent:
    """The configuration that a board has loaded from its EEPROM."""

    status: m.EepromStatus
    config: BoardConfig

    @property
    def can_be_saved_again(self) -> bool:
        """A blank or corrupt EEPROM cannot be restored over the port."""
        return self.status in (m.EepromStatus.LOADED, m.EepromStatus.ONE_SLOT_BAD)


class FoundBoard:
    """Opens the port.

    Raises:
        ConfigError: no device URI.
        DeviceError: there is no board with this firmware, or its port cannot be used.
    """

    def __init__(self, uri: str) -> None:
        self.device = PortDevice(parse_device_uri(uri), RealClock())
        try:
            host = Host(self.device)
            identity = host.hello()
            if identity.spec_hash != m.SPEC_HASH:
                raise SpecMismatchError(identity)
            self._found = _eeprom_content(host)
        except BaseException:
            self.device.close()
            raise

    @property
    def can_be_saved_again(self) -> bool:
        """Whether a save can be undone at the end."""
        return self._found.can_be_saved_again

    def host(self) -> Host:
        """A host of the board, which is reset if the test before has left it speechless.

        Raises:
            DeviceError: that has not helped.
        """
        try:
            return Host(self.device)
        except (AssertionError, DeviceError):
            return _restarted(self.device)

    def leave(self) -> str:
        """Disarm the board, put its EEPROM back; tells how the board is left."""
        try:
            host = _restarted(self.device)
            left = _eeprom_content(host)
            if left == self._found:
                return "disarmed, its EEPROM as found"
            if not self._found.can_be_saved_again:
                return "disarmed; a configuration of this suite is now in its EEPROM"
            _save(host, self._found.config)
            if _eeprom_content(_restarted(self.device)).config != self._found.config:
                raise DeviceError(
                    f"{self.device.name}: the configuration found could not be saved again",
                    f"configure the board again; it had {self._found.config}",
                )
            return "disarmed, the configuration found saved again"
        finally:
            self.device.close()


def _restarted(device: PortDevice) -> Host:
    device.reset(m.ResetCause.EXTERNAL)
    return Host(device)


def _eeprom_content(host: Host) -> EepromContent:
    return EepromContent(host.hello().eeprom_status, host.config())


def _save(host: Host, config: BoardConfig) -> None:
    host.boot()
    host.open_session(SESSION)
    host.clear_latch()
    host.configure(config.limits, config.slew, config.watchdog, config.calibration)
    host.save()
