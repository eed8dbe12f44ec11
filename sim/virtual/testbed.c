#include "testbed.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

static UMockdevTestbed *testbed;
static int refs;

void testbed_enter(char **argv) {
    const char *preload = g_getenv("LD_PRELOAD");
    if (preload && strstr(preload, "umockdev"))
        return;
    g_autofree char *both = g_strjoin(":", "libumockdev-preload.so.0", preload, NULL);
    const char *asan = g_getenv("ASAN_OPTIONS");
    g_autofree char *options = g_strjoin(":", "verify_asan_link_order=0", asan, NULL);
    g_setenv("LD_PRELOAD", both, TRUE);
    g_setenv("ASAN_OPTIONS", options, TRUE);
    execv("/proc/self/exe", argv);
    g_error("cannot start again with umockdev: %s", g_strerror(errno));
}

UMockdevTestbed *testbed_ref(void) {
    if (refs++ == 0)
        testbed = umockdev_testbed_new();
    return testbed;
}

void testbed_unref(void) {
    if (--refs == 0)
        g_clear_object(&testbed);
}
