#include "skip.h"

#include <glib.h>

void test_skip_or_fail(const char *reason) {
    const char *must_run = g_getenv("MESORIG_TESTS_MUST_RUN");
    if (must_run && *must_run && !g_str_equal(must_run, "0"))
        g_test_fail_printf("%s; MESORIG_TESTS_MUST_RUN is set: install what is missing", reason);
    else
        g_test_skip(reason);
}
