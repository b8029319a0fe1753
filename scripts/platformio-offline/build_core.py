"""Fills an isolated PLATFORMIO_CORE_DIR from packages installed by apt and pip.

It contains our replacement development platforms (folder platforms/), and packages that consist of
a manifest and links. Written from PlatformIO's documentation on custom platforms and manifests.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PLATFORMS = Path(__file__).parent / "platforms"
APT_CURE = (
    "sudo apt install gcc-avr avr-libc binutils-avr arduino-core-avr avrdude cppcheck doctest-dev"
)
AVR_TOOLS = ("gcc", "g++", "gcc-ar", "gcc-ranlib", "ar", "as", "ld", "objcopy", "objdump", "size")
SCONS_SCRIPT = "from SCons.Script.Main import main\n\nmain()\n"


def main(core: Path) -> None:
    """Rebuild the folder."""
    if core.exists():
        if not (core / "platforms").is_dir():
            sys.exit(f"error: {core} is not a PlatformIO core folder (name another one)")
        shutil.rmtree(core)
    for platform in sorted(PLATFORMS.iterdir()):
        folder = core / "platforms" / platform.name
        shutil.copytree(platform, folder)
        manifest = json.loads((folder / "platform.json").read_text())
        stamp(folder, "platform", platform.name, manifest["version"])
    packages = core / "packages"
    scons_package(packages / "tool-scons")
    link_package(
        packages / "toolchain-atmelavr",
        "1.50400.0",
        {f"bin/avr-{tool}": program(f"avr-{tool}") for tool in AVR_TOOLS},
    )
    link_package(
        packages / "tool-avrdude",
        "1.70100.0",
        {"bin/avrdude": program("avrdude"), "avrdude.conf": Path("/etc/avrdude.conf")},
    )
    link_package(
        packages / "framework-arduino-avr",
        "5.2.0",
        {name: arduino_core() / name for name in ("cores", "variants", "libraries")},
    )
    link_package(
        packages / "tool-cppcheck",
        core_requirement("tool-cppcheck"),
        {"cppcheck": program("cppcheck")},
    )


def scons_package(folder: Path) -> None:
    """Use pip's SCons as PlatformIO's."""
    try:
        installed = version("scons")
    except PackageNotFoundError:
        sys.exit("error: no SCons (pip install scons)")
    major, minor, patch = (int(part) for part in installed.split("."))
    packaged = f"4.{major}{minor:02d}{patch:02d}.0"
    wanted = core_requirement("tool-scons")
    if packaged != wanted:
        sys.exit(
            f"error: SCons {installed} is package {packaged}, this PlatformIO needs {wanted}"
            " (pip install another version of scons)"
        )
    link_package(folder, packaged, {})
    (folder / "scons.py").write_text(SCONS_SCRIPT)


def core_requirement(package: str) -> str:
    """Version of a package that this PlatformIO requires."""
    try:
        from platformio.dependencies import get_core_dependencies  # noqa: PLC0415
    except ModuleNotFoundError:
        sys.exit("error: no PlatformIO (pip install platformio scons)")
    return str(get_core_dependencies()[package]).removeprefix("~")


def link_package(folder: Path, package_version: str, links: dict[str, Path]) -> None:
    """Create a package that consists of links."""
    folder.mkdir(parents=True)
    manifest = {"name": folder.name, "version": package_version, "description": "Stand-in"}
    (folder / "package.json").write_text(json.dumps(manifest))
    for name, target in links.items():
        if not target.exists():
            sys.exit(f"error: {target} does not exist ({APT_CURE})")
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).symlink_to(target)
    stamp(folder, "tool", folder.name, package_version)


def stamp(folder: Path, kind: str, name: str, package_version: str) -> None:
    """Write the file that marks a package as installed for PlatformIO, with its owner."""
    spec = {"owner": "platformio", "id": None, "name": name, "requirements": None, "uri": None}
    content = {"type": kind, "name": name, "version": package_version, "spec": spec}
    (folder / ".piopm").write_text(json.dumps(content))


def program(name: str) -> Path:
    """Path of a program."""
    path = shutil.which(name)
    if path is None:
        sys.exit(f"error: no {name} ({APT_CURE})")
    return Path(path)


def arduino_core() -> Path:
    """Folder of the Arduino core as installed by apt."""
    for path in files_of("arduino-core-avr"):
        if path.name == "boards.txt":
            return path.parent
    sys.exit(f"error: no Arduino core ({APT_CURE})")


def files_of(package: str) -> Iterable[Path]:
    """Files of an apt package."""
    listed = subprocess.run(
        ["dpkg", "-L", package], capture_output=True, text=True, check=False
    ).stdout
    return map(Path, listed.splitlines())


if __name__ == "__main__":
    if len(sys.argv) != 2:  # noqa: PLR2004 - name and folder
        sys.exit("usage: build_core.py FOLDER")
    main(Path(sys.argv[1]).absolute())
