"""Runs doctest programs for `pio test`, with the doctest.h of this machine.

PlatformIO's own doctest runner fetches the library from the registry, takes a program without test
cases for a success, and reads every assertion that passed, which takes minutes for some ten
thousand. Here doctest prints one line a case, its duration, and what failed before that.
"""

import re

import click
from platformio.test.exception import UnitTestError
from platformio.test.result import TestCase, TestStatus
from platformio.test.runners.base import TestRunnerBase

DOCTEST_OPTIONS = ("--duration=true", "--success=false", "--no-colors=true")
CASE_ENDED = re.compile(r"^\d+\.\d+ s: (?P<name>.*)$")
CASE_FAILED = re.compile(r": (FATAL )?ERROR: ")


class CustomTestRunner(TestRunnerBase):
    """The name is PlatformIO's for `test_framework = custom`."""

    def setup(self) -> None:
        self._failure = None
        self.options.program_args = [*DOCTEST_OPTIONS, *(self.options.program_args or [])]

    def stage_testing(self) -> None:
        super().stage_testing()
        if not self.options.without_testing and not self.test_suite.cases:
            raise UnitTestError("no test case has run")

    def on_testing_line_output(self, line: str) -> None:
        ended = CASE_ENDED.match(line.rstrip())
        if ended is None:
            click.echo(line, nl=False)
            if self._failure is None and CASE_FAILED.search(line):
                self._failure = line.strip()
            return
        status = TestStatus.FAILED if self._failure else TestStatus.PASSED
        self.test_suite.add_case(TestCase(ended["name"], status, message=self._failure))
        self._failure = None
