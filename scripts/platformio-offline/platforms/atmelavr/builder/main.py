"""Build script of the replacement platform: avr-gcc, avr-objcopy, avr-size, avrdude."""

from pathlib import Path

from SCons.Script import (
    COMMAND_LINE_TARGETS,
    AlwaysBuild,
    Builder,
    Default,
    DefaultEnvironment,
)

env = DefaultEnvironment()
board = env.BoardConfig()
avrdude = env.PioPlatform().get_package_dir("tool-avrdude") or ""

env.Replace(
    AR="avr-gcc-ar",
    AS="avr-as",
    CC="avr-gcc",
    CXX="avr-g++",
    OBJCOPY="avr-objcopy",
    RANLIB="avr-gcc-ranlib",
    SIZETOOL="avr-size",
    ARFLAGS=["rc"],
    PROGNAME="firmware",
    PROGSUFFIX=".elf",
    SIZEPROGREGEXP=r"^(?:\.text|\.data|\.bootloader)\s+(\d+).*",
    SIZEDATAREGEXP=r"^(?:\.data|\.bss|\.noinit)\s+(\d+).*",
    SIZECHECKCMD="$SIZETOOL -A -d $SOURCES",
    SIZEPRINTCMD="$SIZETOOL -B -d $SOURCES",
    UPLOADER="avrdude",
    UPLOADERFLAGS=[
        *("-p", "$BOARD_MCU", "-C", str(Path(avrdude) / "avrdude.conf")),
        *("-c", "$UPLOAD_PROTOCOL", "-b", "$UPLOAD_SPEED", "-P", "$UPLOAD_PORT", "-D"),
    ],
    UPLOADCMD="$UPLOADER $UPLOADERFLAGS -U flash:w:$SOURCES:i",
)

# As in the Arduino core's platform.txt.
env.Append(
    ASFLAGS=["-mmcu=$BOARD_MCU"],
    ASPPFLAGS=["-x", "assembler-with-cpp"],
    CFLAGS=["-std=gnu11", "-fno-fat-lto-objects"],
    CCFLAGS=[
        *("-mmcu=$BOARD_MCU", "-Os", "-Wall", "-flto"),
        *("-ffunction-sections", "-fdata-sections"),
    ],
    CXXFLAGS=[
        *("-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics", "-fpermissive"),
        "-Wno-error=narrowing",
    ],
    CPPDEFINES=[("F_CPU", "$BOARD_F_CPU")],
    LINKFLAGS=["-mmcu=$BOARD_MCU", "-Os", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections"],
    LIBS=["m"],
    BUILDERS={
        "ElfToHex": Builder(
            action=env.VerboseAction(
                "$OBJCOPY -O ihex -R .eeprom $SOURCES $TARGET", "Building $TARGET"
            ),
            suffix=".hex",
        )
    },
)
env.Append(ASPPFLAGS=env.get("CCFLAGS", []))

if "nobuild" in COMMAND_LINE_TARGETS:
    firmware = str(Path(env.subst("$BUILD_DIR")) / "${PROGNAME}.hex")
    elf = str(Path(env.subst("$BUILD_DIR")) / "${PROGNAME}.elf")
else:
    elf = env.BuildProgram()
    firmware = env.ElfToHex(str(Path("$BUILD_DIR") / "${PROGNAME}"), elf)
    env.Depends(firmware, "checkprogsize")

AlwaysBuild(env.Alias("nobuild", firmware))
buildprog = env.Alias("buildprog", firmware, firmware)

env.AddPlatformTarget(
    "size",
    elf,
    env.VerboseAction("$SIZEPRINTCMD", "Calculating size $SOURCE"),
    "Program Size",
    "Calculate program size",
)
env.AddPlatformTarget(
    "upload",
    firmware,
    [
        env.VerboseAction(env.AutodetectUploadPort, "Looking for upload port..."),
        env.VerboseAction("$UPLOADCMD", "Uploading $SOURCE"),
    ],
    "Upload",
)

Default([buildprog])
