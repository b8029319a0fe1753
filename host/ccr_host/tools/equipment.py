"""The board's name and equipment, stored in its EEPROM, read and changed by the host."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ccr_host.core.errors import ConfigError
from ccr_host.description.robot import LONGEST_BOARD_NAME, checked_board_name
from ccr_host.description.schema import Description
from ccr_host.link.board_config import board_config, board_name
from ccr_host.link.client import Client
from ccr_host.link.messages import Equipment, Fault, StatusFlags
from ccr_host.link.transport import parse_device_uri
from ccr_host.run.open_rig import open_board
from ccr_host.run.options import RigOptions

_REFERENCE_V = 5.0
_U8_MAX = 255


@dataclass(frozen=True)
class EquipmentChange:
    """Requested changes; None leaves a value unchanged."""

    board_name: str | None = None
    emergency_stop: bool | None = None
    supply_divider: float | None = None
    """Servo supply voltage over the voltage at the board's pin; 0: not wired."""
    supply_min_v: float | None = None

    def applied_to(self, equipment: Equipment) -> Equipment:
        """The equipment with this change.

        Raises:
            ConfigError: the board cannot store the result.
        """
        if self.board_name is not None:
            equipment = replace(equipment, board_name=_name_bytes(self.board_name))
        if self.emergency_stop is not None:
            equipment = replace(equipment, emergency_stop=int(self.emergency_stop))
        if self.supply_divider is not None:
            full_v = self.supply_divider * _REFERENCE_V
            equipment = replace(equipment, supply_full_dv=_deci(full_v, "--supply-divider"))
        if self.supply_min_v is not None:
            equipment = replace(equipment, supply_min_dv=_deci(self.supply_min_v, "--supply-min"))
        if equipment.supply_min_dv > equipment.supply_full_dv:
            raise ConfigError(
                f"a supply of {equipment.supply_min_dv / 10:g} V cannot be measured with a divider "
                f"for up to {equipment.supply_full_dv / 10:g} V",
                "give --supply-divider N as it is wired, or --supply-min 0",
            )
        return equipment


def change_equipment(
    client: Client, description: Description, change: EquipmentChange
) -> Equipment:
    """Change the equipment and save it in the board.

    The board is not armed. One without a configuration gets that of ``description``, as a board
    saves all or nothing.

    Raises:
        ConfigError: the board cannot store the result.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    wanted = change.applied_to(client.read_equipment())
    client.set_equipment(wanted)
    if StatusFlags.CONFIGURED not in client.read_state().flags:
        client.configure(board_config(description))
    client.save_config()
    return wanted


def set_equipment(options: RigOptions, change: EquipmentChange) -> str:
    """Connect, change and save; return the board's equipment as text.

    Raises:
        ConfigError: unknown URI, or the board cannot store the result.
        DeviceError: no board, or it refuses.
    """
    device = parse_device_uri(options.device)
    description = options.description()
    with open_board(device, description, options.seed) as (client, _):
        text = equipment_text(change_equipment(client, description, change))
        if client.read_state().fault is Fault.EMERGENCY_STOP:
            text += " (now open: the board stays in fault until it is closed and cleared)"
        return text


def equipment_text(equipment: Equipment) -> str:
    """The equipment in words."""
    name = board_name(equipment)
    stop = "emergency stop fitted" if equipment.emergency_stop else "no emergency stop"
    supply = "supply not measured"
    if equipment.supply_full_dv:
        supply = f"supply measured up to {equipment.supply_full_dv / 10:g} V"
        if equipment.supply_min_dv:
            supply += f", a fault below {equipment.supply_min_dv / 10:g} V"
    return f"{f'named {name}' if name else 'no name'}, {stop}, {supply}"


def _deci(voltage_v: float, option: str) -> int:
    """A voltage in units of 0.1 V."""
    deci = voltage_v * 10
    if not 0 <= deci <= _U8_MAX:
        raise ConfigError(
            f"{option}: a supply of {voltage_v:g} V is out of range",
            f"the board supports 0 to {_U8_MAX / 10:g} V",
        )
    return round(deci)


def _name_bytes(name: str) -> tuple[int, ...]:
    try:
        checked = checked_board_name(name)
    except ValueError as error:
        raise ConfigError(f"--board-name: {error}", "choose another name") from None
    return tuple(checked.encode("ascii").ljust(LONGEST_BOARD_NAME, b"\0"))
