"""Small programs for the rig, built with avr-gcc."""

import subprocess
from pathlib import Path

import pytest

from ccr_host.sim.simavr.board import SimavrBoard
from ccr_host.sim.simavr.flash_image import read_flash_image

PROGRAMS = Path(__file__).parent / "programs"
FLAGS = ["-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os", "-Wall", "-Werror", "-std=gnu11"]


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    """Path of the ELF file of a program, by its name."""
    folder = tmp_path_factory.mktemp("programs")

    def build(name):
        elf = folder / f"{name}.elf"
        if not elf.exists():
            subprocess.run(
                ["avr-gcc", *FLAGS, str(PROGRAMS / f"{name}.c"), "-o", str(elf)],
                check=True,
            )
        return elf

    return build


@pytest.fixture
def board(program):
    """Create a board with a program."""

    def make(name, **options):
        return SimavrBoard(read_flash_image(program(name)), **options)

    return make


@pytest.fixture
def exchange():
    """Send bytes to a board and return its output within 5 ms."""

    def run(board, data, wait_us=5000):
        board.receive(data)
        board.advance_to(board.now_us + wait_us)
        return board.take_output()

    return run
