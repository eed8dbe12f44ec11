#include "lock_keeper.h"

#include "drivers/device.h"
#include "process.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

pid_t lock_keeper_start(const char *key) {
    pid_t holder = 0;
    const pid_t keeper = fork();
    g_assert_cmpint(keeper, >=, 0);
    if (keeper == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        lock_take(key, LOCK_ALONE, "it", NULL);
        pause();
        _exit(0);
    }
    while (!lock_holder(key, &holder))
        g_usleep(1000);
    g_assert_cmpint(holder, ==, keeper);
    return keeper;
}

void lock_keeper_end(pid_t keeper) {
    kill(keeper, SIGKILL);
    g_assert_cmpint(waitpid(keeper, NULL, 0), ==, keeper);
}

void lock_keeper_expect(pid_t keeper, GError **error) {
    g_autofree char *words = g_strdup_printf("(process %d) uses it; end that program", (int)keeper);
    g_assert_error(*error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    assert_has((*error)->message, words);
    g_clear_error(error);
}
