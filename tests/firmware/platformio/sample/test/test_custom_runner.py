"""Runs doctest programs for `pio test` with the doctest.h of this machine.

PlatformIO's own doctest runner fetches the library from the registry, and takes a program that
reports no test case for a success.
"""

from platformio.test.exception import UnitTestError
from platformio.test.runners.doctest import DoctestTestRunner


class CustomTestRunner(DoctestTestRunner):
    EXTRA_LIB_DEPS = None

    def setup(self):
        self.options.program_args = ["--success", *(self.options.program_args or [])]

    def stage_testing(self):
        super().stage_testing()
        if not self.options.without_testing and not self.test_suite.cases:
            raise UnitTestError("no test case has run")
