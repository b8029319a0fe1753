#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#ifndef EXPECTED
#define EXPECTED 4
#endif

#ifndef WITHOUT_CASES
TEST_CASE("two and two") { CHECK(2 + 2 == EXPECTED); }
TEST_CASE("two and three") { CHECK(2 + 3 == 5); }
#endif
