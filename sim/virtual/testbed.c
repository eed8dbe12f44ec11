#include "testbed.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#define CLOSURES "mesorig closures"

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

gboolean testbed_is_entered(void) {
    g_autofree char *maps = NULL;
    return g_file_get_contents("/proc/self/maps", &maps, NULL, NULL) &&
           strstr(maps, "libumockdev-preload");
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

static void on_finalized(gpointer n_closures, GClosure *closure) {
    g_atomic_int_dec_and_test((gint *)n_closures);
}

void testbed_connect(UMockdevIoctlBase *handler, const char *signal, GCallback func,
                     gpointer data) {
    gint *n_closures = g_object_get_data(G_OBJECT(handler), CLOSURES);
    GClosure *closure = g_cclosure_new(func, data, NULL);
    if (!n_closures) {
        n_closures = g_new0(gint, 1);
        g_object_set_data_full(G_OBJECT(handler), CLOSURES, n_closures, g_free);
    }
    g_atomic_int_inc(n_closures);
    g_closure_add_finalize_notifier(closure, n_closures, on_finalized);
    g_signal_connect_closure(handler, signal, closure, FALSE);
}

/* A closure exists while a thread is calling it. This function therefore waits until there are no
 * closures any more. */
void testbed_disconnect(UMockdevIoctlBase *handler, gpointer data) {
    const gint *n_closures = g_object_get_data(G_OBJECT(handler), CLOSURES);
    g_signal_handlers_disconnect_by_data(handler, data);
    while (n_closures && g_atomic_int_get(n_closures) > 0)
        g_usleep(1000);
}
