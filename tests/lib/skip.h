/* For tests that need something that not every machine has: OpenGL, a display, mounts, an installed
 * tool. */
#pragma once

/* Reports that the running test cannot run on this machine. Normally the test then counts as
 * skipped. If MESORIG_TESTS_MUST_RUN is set and not 0, as in ./run test, the test fails, because
 * the full run installs everything that tests need. The caller then returns. */
void test_skip_or_fail(const char *reason);
