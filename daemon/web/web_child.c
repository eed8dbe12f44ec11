#include "web_child.h"

#include "base/program.h"

#include <gio/gio.h>
#include <string.h>
#include <sys/resource.h>

#define NICE     10
#define MAX_TEXT (64 << 10) /* bytes of an output or error message */

/* A process that runs. */
struct running {
    WebChild *child; /* NULL after web_child_free() */
    GSubprocess *process;
    guint limit_id;
    WebChildDone done;
    gpointer data;
};

struct WebChild {
    struct running *running; /* NULL if no process runs */
};

WebChild *web_child_new(void) {
    return g_new0(WebChild, 1);
}

void web_child_free(WebChild *child) {
    if (!child)
        return;
    struct running *running = child->running;
    if (running) {
        running->child = NULL;
        g_subprocess_force_exit(running->process);
        g_subprocess_wait(running->process, NULL, NULL);
        running->done(FALSE, "the server has ended", running->data);
    }
    g_free(child);
}

static char *text_of(GBytes *bytes) {
    gsize length = 0;
    const char *data = bytes ? g_bytes_get_data(bytes, &length) : NULL;
    g_autofree char *text = g_strndup(data ? data : "", MIN(length, MAX_TEXT));
    return g_utf8_make_valid(g_strstrip(text), -1);
}

/* Returns the message of mesorig without its progress; g_free(). */
static char *message_of(GBytes *bytes) {
    g_autofree char *all = text_of(bytes);
    const char *last = g_strrstr(all, "mesorig: ");
    const char *text = last ? last + strlen("mesorig: ") : all;
    return *text ? g_strdup(text)
                 : g_strdup("mesorig has ended without a message: it took too long, or the "
                            "computer has too little memory");
}

static void on_ended(GObject *process, GAsyncResult *result, gpointer data) {
    struct running *running = data;
    g_autoptr(GBytes) out = NULL, said = NULL;
    const gboolean ended =
        g_subprocess_communicate_finish(G_SUBPROCESS(process), result, &out, &said, NULL);
    const gboolean ok = ended && g_subprocess_get_successful(running->process);
    g_clear_handle_id(&running->limit_id, g_source_remove);
    if (running->child) {
        g_autofree char *text = ok ? text_of(out) : message_of(said);
        running->child->running = NULL;
        running->done(ok, text, running->data);
    }
    g_object_unref(running->process);
    g_free(running);
}

static gboolean on_limit(gpointer data) {
    struct running *running = data;
    running->limit_id = 0;
    g_subprocess_force_exit(running->process);
    return G_SOURCE_REMOVE;
}

static void be_nice(gpointer data) {
    setpriority(PRIO_PROCESS, 0, NICE);
}

gboolean web_child_start(WebChild *child, const char *const *arguments, WebChildDone done,
                         gpointer data, GError **error) {
    if (child->running) {
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_BUSY,
                            "another file is being made: try again when it is ready");
        return FALSE;
    }
    g_autofree char *program = program_find("mesorig", error);
    if (!program)
        return FALSE;
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_ptr_array_add(argv, program);
    for (int i = 0; arguments[i]; i++)
        g_ptr_array_add(argv, (gpointer)arguments[i]);
    g_ptr_array_add(argv, NULL);
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_PIPE);
    g_subprocess_launcher_set_child_setup(launcher, be_nice, NULL, NULL);
    GSubprocess *process =
        g_subprocess_launcher_spawnv(launcher, (const char *const *)argv->pdata, error);
    if (!process)
        return FALSE;
    struct running *running = child->running = g_new(struct running, 1);
    *running = (struct running){.child = child, .process = process, .done = done, .data = data};
    running->limit_id = g_timeout_add_seconds(WEB_CHILD_LIMIT_S, on_limit, running);
    g_subprocess_communicate_async(process, NULL, NULL, on_ended, running);
    return TRUE;
}
