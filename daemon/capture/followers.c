#include "followers.h"

#include "base/program.h"

#include <gio/gio.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#define END_WAIT_MS 3000

struct child {
    Followers *owner;
    char *directory;
    GSubprocess *process;
    GCancellable *watch;
    gboolean running;
};

struct Followers {
    GPtrArray *children;
    void (*changed)(gpointer data);
    void (*failed)(const char *directory, gpointer data);
    gpointer data;
};

/* Runs in the new process between fork and exec. Only async-signal-safe functions may be called
 * here. */
static void prepare_child(gpointer parent) {
    setpriority(PRIO_PROCESS, 0, 10);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != GPOINTER_TO_INT(parent))
        _exit(1);
}

static void child_free(gpointer data) {
    struct child *child = data;
    g_cancellable_cancel(child->watch);
    if (child->running) {
        g_subprocess_send_signal(child->process, SIGTERM);
        for (int ms = 0; ms < END_WAIT_MS && g_subprocess_get_identifier(child->process); ms += 10)
            g_usleep(10 * 1000);
        g_subprocess_force_exit(child->process);
        g_subprocess_wait(child->process, NULL, NULL);
    }
    g_object_unref(child->watch);
    g_object_unref(child->process);
    g_free(child->directory);
    g_free(child);
}

static void child_ended(GObject *source, GAsyncResult *result, gpointer data) {
    g_autoptr(GError) error = NULL;
    if (!g_subprocess_wait_finish(G_SUBPROCESS(source), result, &error))
        return; /* cancelled: child_free() was called */
    struct child *child = data;
    Followers *followers = child->owner;
    child->running = FALSE;
    if (!g_subprocess_get_successful(child->process))
        followers->failed(child->directory, followers->data);
    g_ptr_array_remove(followers->children, child);
    followers->changed(followers->data);
}

Followers *followers_new(void (*changed)(gpointer data),
                         void (*failed)(const char *directory, gpointer data), gpointer data) {
    Followers *followers = g_new(Followers, 1);
    *followers = (Followers){g_ptr_array_new_with_free_func(child_free), changed, failed, data};
    return followers;
}

void followers_free(Followers *followers) {
    if (!followers)
        return;
    g_ptr_array_unref(followers->children);
    g_free(followers);
}

gboolean followers_start(Followers *followers, const char *directory, GError **error) {
    g_autofree char *program = program_find("mesorig", error);
    if (!program)
        return FALSE;
    for (guint i = followers->children->len; i-- > 0;) {
        const struct child *earlier = followers->children->pdata[i];
        if (strcmp(earlier->directory, directory) == 0)
            g_ptr_array_remove_index(followers->children, i);
    }
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE);
    g_subprocess_launcher_set_child_setup(launcher, prepare_child, GINT_TO_POINTER(getpid()), NULL);
    GSubprocess *process = g_subprocess_launcher_spawn(launcher, error, program, "process",
                                                       directory, "--follow", NULL);
    if (process) {
        struct child *child = g_new(struct child, 1);
        *child = (struct child){followers, g_strdup(directory), process, g_cancellable_new(), TRUE};
        g_ptr_array_add(followers->children, child);
        g_subprocess_wait_async(process, child->watch, child_ended, child);
    }
    followers->changed(followers->data);
    return process != NULL;
}

const char **followers_directories(const Followers *followers) {
    const guint n = followers->children->len;
    const char **directories = g_new0(const char *, n + 1);
    for (guint i = 0; i < n; i++)
        directories[i] = ((const struct child *)followers->children->pdata[i])->directory;
    return directories;
}
