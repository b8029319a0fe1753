"""Build script of the replacement platform: the compiler of this machine."""

from SCons.Script import AlwaysBuild, Default, DefaultEnvironment

env = DefaultEnvironment()
env.Replace(PROGNAME="program")
program = env.BuildProgram()
AlwaysBuild(env.Alias("nobuild", program))
AlwaysBuild(env.Alias("exec", program, env.VerboseAction("$PROG_PATH", "Executing $SOURCE")))
Default([env.Alias("buildprog", program, program)])
