"""The board's name and what is wired to it: kept in its EEPROM, told and changed by the host."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import LONGEST_BOARD_NAME, Description, checked_board_name
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
    """What is to be changed; None leaves it."""

    board_name: str | None = None
    emergency_stop: bool | None = None
    supply_divider: float | None = None
    """Servo supply over what reaches the board's pin; 0: none is wired."""
    supply_min_v: float | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to be changed."""
        return self == EquipmentChange()

    def applied_to(self, equipment: Equipment) -> Equipment:
        """The equipment with this change.

        Raises:
            ConfigError: the board cannot keep it.
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
                f"a supply of {equipment.supply_min_dv / 10:g} V cannot be seen with a divider for "
                f"up to {equipment.supply_full_dv / 10:g} V",
                "give --supply-divider N as it is wired, or --supply-min 0",
            )
        return equipment


def change_equipment(
    client: Client, description: Description, change: EquipmentChange
) -> Equipment:
    """Set it and let the board save it.

    Args:
        client: connected, to a board that is not armed.
        description: configures a board that has no configuration yet, as it saves all or nothing.
        change: what to change.

    Raises:
        ConfigError: the board cannot keep it.
        DeviceError: the board refuses, or its EEPROM fails.
    """
    wanted = change.applied_to(client.read_equipment())
    client.set_equipment(wanted)
    if StatusFlags.CONFIGURED not in client.read_state().flags:
        client.configure(board_config(description))
    client.save_config()
    return wanted


def told_to_board(options: RigOptions, change: EquipmentChange) -> str:
    """Connect, change and save; gives the board's equipment then, for people.

    Raises:
        ConfigError: unknown URI, or the board cannot keep it.
        DeviceError: no board, or it refuses.
    """
    device = parse_device_uri(options.device)
    description = options.description()
    with open_board(device, description, options.seed) as (client, _):
        told = described(change_equipment(client, description, change))
        if client.read_state().fault is Fault.EMERGENCY_STOP:
            told += " (open now: the board is in fault until it is closed and cleared)"
        return told


def described(equipment: Equipment) -> str:
    """For people."""
    name = board_name(equipment)
    stop = "emergency stop fitted" if equipment.emergency_stop else "no emergency stop"
    supply = "supply not measured"
    if equipment.supply_full_dv:
        supply = f"supply measured up to {equipment.supply_full_dv / 10:g} V"
        if equipment.supply_min_dv:
            supply += f", a fault below {equipment.supply_min_dv / 10:g} V"
    return f"{f'named {name}' if name else 'no name'}, {stop}, {supply}"


def _deci(voltage_v: float, option: str) -> int:
    """In 0.1 V."""
    deci = voltage_v * 10
    if not 0 <= deci <= _U8_MAX:
        raise ConfigError(
            f"{option}: the board cannot take {voltage_v:g} V at its supply",
            f"it takes 0 to {_U8_MAX / 10:g} V",
        )
    return round(deci)


def _name_bytes(name: str) -> tuple[int, ...]:
    try:
        checked = checked_board_name(name)
    except ValueError as error:
        raise ConfigError(f"--board-name: {error}", "choose another name") from None
    return tuple(checked.encode("ascii").ljust(LONGEST_BOARD_NAME, b"\0"))
