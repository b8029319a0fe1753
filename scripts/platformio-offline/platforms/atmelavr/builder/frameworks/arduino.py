"""The Arduino core as a library of the firmware."""

from pathlib import Path

from SCons.Script import DefaultEnvironment

env = DefaultEnvironment()
board = env.BoardConfig()
core = Path(env.PioPlatform().get_package_dir("framework-arduino-avr"))
sources = core / "cores" / board.get("build.core")
variant = core / "variants" / board.get("build.variant")

env.Append(
    CPPDEFINES=[
        ("ARDUINO", 10808),
        "ARDUINO_ARCH_AVR",
        (
            "DECIMAL_DIG",
            "__DECIMAL_DIG__",
        ),  # avr-gcc 5.4 knows only the latter; WString.cpp needs it
    ],
    CPPPATH=[str(sources), str(variant)],
    LIBSOURCE_DIRS=[str(core / "libraries")],
)
env.MergeFlags(board.get("build.extra_flags", ""))
library = env.BuildLibrary(str(Path("$BUILD_DIR") / "FrameworkArduino"), str(sources))
env.Prepend(LIBS=[library])
