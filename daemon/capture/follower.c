#include "follower.h"

#include "base/program.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#define END_WAIT_MS 3000

struct Follower {
    GSubprocess *child;
    GCancellable *watch;
    gboolean running;
};

/* Runs between fork and exec, where only async-signal-safe functions may be called. */
static void prepare_child(gpointer parent) {
    setpriority(PRIO_PROCESS, 0, 10);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != GPOINTER_TO_INT(parent))
        _exit(1);
}

static void child_ended(GObject *source, GAsyncResult *result, gpointer data) {
    g_autoptr(GError) error = NULL;
    GSubprocess *child = G_SUBPROCESS(source);
    Follower *follower = data;
    if (!g_subprocess_wait_finish(child, result, &error))
        return; /* cancelled: the follower is gone */
    follower->running = FALSE;
    if (!g_subprocess_get_successful(child))
        g_message("processing during the capture has failed: run `mesorig process` when the "
                  "capture has ended");
}

Follower *follower_start(const char *directory, GError **error) {
    g_autofree char *program = program_find("mesorig", error);
    if (!program)
        return NULL;
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE);
    g_subprocess_launcher_set_child_setup(launcher, prepare_child, GINT_TO_POINTER(getpid()), NULL);
    GSubprocess *child = g_subprocess_launcher_spawn(launcher, error, program, "process", directory,
                                                     "--follow", NULL);
    if (!child)
        return NULL;
    Follower *follower = g_new0(Follower, 1);
    follower->child = child;
    follower->watch = g_cancellable_new();
    follower->running = TRUE;
    g_subprocess_wait_async(child, follower->watch, child_ended, follower);
    return follower;
}

void follower_free(Follower *follower) {
    if (!follower)
        return;
    g_cancellable_cancel(follower->watch);
    if (follower->running) {
        g_subprocess_send_signal(follower->child, SIGTERM);
        for (int ms = 0; ms < END_WAIT_MS && g_subprocess_get_identifier(follower->child); ms += 10)
            g_usleep(10 * 1000);
        g_subprocess_force_exit(follower->child);
        g_subprocess_wait(follower->child, NULL, NULL);
    }
    g_object_unref(follower->watch);
    g_object_unref(follower->child);
    g_free(follower);
}
