"""PlatformIO builds, tests, checks and uploads without access to its registry."""

import serial

from ccr_host.link.messages import BAUD
from ccr_host.sim.simavr.board import SimavrBoard
from ccr_host.sim.simavr.flash_image import read_flash_image
from ccr_host.sim.simavr.serve import open_pty_server


def test_run_builds_a_firmware_that_works(pio, project):
    result = pio(project, "run")
    assert result.returncode == 0, result.stdout + result.stderr
    uno = SimavrBoard(read_flash_image(project / ".pio/build/uno/firmware.elf"))
    uno.advance_to(10_000)
    uno.receive(b"HAL", BAUD)
    uno.advance_to(20_000)
    assert uno.take_output() == b"IBM"


def test_hex_and_elf_hold_the_same_program(pio, project):
    pio(project, "run")
    build = project / ".pio/build/uno"
    names = ("firmware.elf", "firmware.hex")
    boards = [SimavrBoard(read_flash_image(build / name)) for name in names]
    from_elf, from_hex = (board.mcu.flash.tobytes() for board in boards)
    assert from_elf == from_hex


def test_native_tests_that_pass(pio, project):
    result = pio(project, "test", "-e", "native")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 test cases: 2 succeeded" in result.stdout


def test_native_test_that_fails(pio, project):
    result = pio(project, "test", "-e", "native", PLATFORMIO_BUILD_FLAGS="-DEXPECTED=5")
    assert result.returncode != 0
    assert "1 failed" in result.stdout + result.stderr


def test_native_tests_without_a_case_fail(pio, project):
    result = pio(project, "test", "-e", "native", PLATFORMIO_BUILD_FLAGS="-DWITHOUT_CASES")
    assert result.returncode != 0
    assert "no test case has run" in result.stdout + result.stderr


def test_check_finds_a_defect(pio, project):
    clean = pio(project, "check", "--fail-on-defect=high", "--skip-packages")
    assert clean.returncode == 0, clean.stdout + clean.stderr
    (project / "src/main.cpp").write_text(
        "#include <Arduino.h>\nvoid setup() { int a[2]; a[2] = 1; }\nvoid loop() {}\n"
    )
    defect = pio(project, "check", "--fail-on-defect=high", "--skip-packages")
    assert defect.returncode != 0
    assert "arrayIndexOutOfBounds" in defect.stdout


def test_upload_flashes_a_board_behind_a_port(pio, project):
    with open_pty_server(None) as server:
        port = server.uri.removeprefix("serial:")
        result = pio(project, "run", "-t", "upload", "--upload-port", port)
        assert result.returncode == 0, result.stdout + result.stderr
        with serial.Serial(port, BAUD, timeout=0.5) as opened:
            answer = b""
            for _ in range(200):  # optiboot first waits for another upload
                opened.reset_input_buffer()
                opened.write(b"HAL")
                answer = opened.read(3)
                if len(answer) == 3:
                    break
        assert answer == b"IBM"


def test_foreign_folder_is_not_deleted(pio, project, tmp_path):
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious/file").touch()
    result = pio(project, "run", CCR_PLATFORMIO_CORE=str(tmp_path / "precious"))
    assert result.returncode != 0
    assert result.stderr.startswith("error:")
    assert (tmp_path / "precious/file").exists()
