#include "lock_keeper.h"

#include "drivers/device.h"
#include "ok.h"
#include "process.h"
#include "wait.h"

#include <stdlib.h>
#include <unistd.h>

#define KEY "MESORIG_TEST_KEEP_LOCK" /* in the environment: makes this program a keeper */

/* The keeper is this program, started again: the child of a fork could wait forever for a lock of
 * the memory allocator that another thread had at the moment of the fork. */
__attribute__((constructor)) static void become_keeper(void) {
    const char *key = g_getenv(KEY);
    if (!key)
        return;
    lock_take(key, LOCK_ALONE, "it", NULL);
    for (;;)
        pause();
}

GSubprocess *lock_keeper_start(const char *key) {
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *keep = g_strconcat(KEY "=", key, NULL);
    GSubprocess *keeper = process_start(G_SUBPROCESS_FLAGS_NONE, NULL,
                                        (const char *[]){"/usr/bin/env", keep, self, NULL});
    pid_t holder = 0;
    UNTIL (lock_holder(key, &holder))
        g_usleep(1000);
    g_assert_cmpint(holder, ==, atoi(g_subprocess_get_identifier(keeper)));
    return keeper;
}

void lock_keeper_end(GSubprocess *keeper) {
    g_subprocess_force_exit(keeper);
    ok(g_subprocess_wait(keeper, NULL, ERR));
    g_object_unref(keeper);
}

void lock_keeper_expect(GSubprocess *keeper, GError **error) {
    g_autofree char *words = g_strdup_printf("(process %s) uses it; end that program",
                                             g_subprocess_get_identifier(keeper));
    g_assert_error(*error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    assert_has((*error)->message, words);
    g_clear_error(error);
}
