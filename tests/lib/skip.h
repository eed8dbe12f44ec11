/* Tests that need what not every machine has: OpenGL, a display, mounts, an installed tool. */
#pragma once

/* Says that the running test cannot run here. By hand the test counts as skipped; where
 * MESORIG_TESTS_MUST_RUN is set and not 0, as in ./run test, it fails, since the full run installs
 * everything that tests need. The caller returns. */
void test_skip_or_fail(const char *reason);
