#include "hooks.h"

#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "hooks_child.h"

struct event {
    char *what, *json, *title, *session, *name, *device, *message;
};

struct Hooks {
    const struct hooks_conf *conf;
    struct event *event; /* the event that is handled; NULL if there is none */
    GQueue waiting;      /* of struct event, the oldest first */
    GQueue programs;     /* paths (char *) of the programs that must still run for the event */
    gboolean busy;       /* whether the first of programs runs */
    GCancellable *cancellable;
};

static void event_free(gpointer data) {
    struct event *event = data;
    char *const strings[] = {event->what, event->json,   event->title,  event->session,
                             event->name, event->device, event->message};
    for (gsize i = 0; i < G_N_ELEMENTS(strings); i++)
        g_free(strings[i]);
    g_free(event);
}

/* Returns whether the file or folder belongs to root or to the user of this program, and no other
 * user may write to it. If not, writes a warning to the log. */
static gboolean is_trusted(const char *path, const struct stat *info) {
    if ((info->st_uid == 0 || info->st_uid == geteuid()) && !(info->st_mode & 022))
        return TRUE;
    g_warning("%s is not used: it belongs to user %u and has mode %04o; make root or user %u its "
              "owner, and let only the owner write it (chown, chmod go-w)",
              path, info->st_uid, (guint)info->st_mode & 07777, (guint)geteuid());
    return FALSE;
}

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static void push_executable(Hooks *hooks, const char *name) {
    g_autofree char *path = g_build_filename(hooks->conf->folder, name, NULL);
    struct stat info;
    if (*name == '.' || g_str_has_suffix(name, "~") || stat(path, &info) != 0 ||
        !S_ISREG(info.st_mode) || !(info.st_mode & 0111) || !is_trusted(path, &info))
        return;
    g_queue_push_tail(&hooks->programs, g_steal_pointer(&path));
}

static void push_executables(Hooks *hooks) {
    g_autoptr(GDir) dir = g_dir_open(hooks->conf->folder, 0, NULL);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    struct stat info;
    if (!dir || stat(hooks->conf->folder, &info) != 0 || !is_trusted(hooks->conf->folder, &info))
        return;
    for (const char *name; (name = g_dir_read_name(dir));)
        g_ptr_array_add(names, g_strdup(name));
    g_ptr_array_sort(names, by_name);
    for (guint i = 0; i < names->len; i++)
        push_executable(hooks, names->pdata[i]);
}

static void next(Hooks *hooks);

static void on_child(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    hooks_child_finish(result, &error);
    if (g_cancellable_is_cancelled(g_task_get_cancellable(G_TASK(result)))) {
        g_clear_error(&error); /* the hooks were freed */
        return;
    }
    if (error)
        g_warning("%s", error->message);
    g_clear_error(&error);
    Hooks *hooks = data;
    g_free(g_queue_pop_head(&hooks->programs));
    hooks->busy = FALSE;
    next(hooks);
}

static void run_first(Hooks *hooks) {
    const struct event *event = hooks->event;
    g_auto(GStrv) environ = g_get_environ();
    const struct {
        const char *name, *value;
    } variables[] = {{"MESORIG_EVENT", event->what},      {"MESORIG_TITLE", event->title},
                     {"MESORIG_SESSION", event->session}, {"MESORIG_NAME", event->name},
                     {"MESORIG_DEVICE", event->device},   {"MESORIG_MESSAGE", event->message}};
    for (gsize i = 0; i < G_N_ELEMENTS(variables); i++)
        environ = g_environ_setenv(environ, variables[i].name, variables[i].value, TRUE);
    environ = g_environ_unsetenv(environ, "NOTIFY_SOCKET");
    const char *const argv[] = {g_queue_peek_head(&hooks->programs), NULL};
    g_autofree char *input = g_strconcat(event->json, "\n", NULL);
    hooks_child_run(argv, (const char *const *)environ, input, hooks->conf->time_limit_s,
                    hooks->cancellable, on_child, hooks);
}

/* Runs the next program of the event. If there is none, continues with the next event. */
static void next(Hooks *hooks) {
    if (hooks->busy)
        return;
    while (g_queue_is_empty(&hooks->programs)) {
        g_clear_pointer(&hooks->event, event_free);
        hooks->event = g_queue_pop_head(&hooks->waiting);
        if (!hooks->event)
            return;
        push_executables(hooks);
    }
    hooks->busy = TRUE;
    run_first(hooks);
}

Hooks *hooks_new(const struct hooks_conf *conf) {
    Hooks *hooks = g_new0(Hooks, 1);
    hooks->conf = conf;
    hooks->cancellable = g_cancellable_new();
    g_queue_init(&hooks->waiting);
    g_queue_init(&hooks->programs);
    return hooks;
}

void hooks_free(Hooks *hooks) {
    if (!hooks)
        return;
    g_cancellable_cancel(hooks->cancellable);
    g_clear_pointer(&hooks->event, event_free);
    g_queue_clear_full(&hooks->waiting, event_free);
    g_queue_clear_full(&hooks->programs, g_free);
    g_object_unref(hooks->cancellable);
    g_free(hooks);
}

static char *dup_detail(GVariant *details, const char *key) {
    const char *text = "";
    g_variant_lookup(details, key, "&s", &text);
    return g_strdup(text);
}

void hooks_tell(Hooks *hooks, const char *what, GVariant *details) {
    g_autoptr(GVariant) owned = g_variant_ref_sink(details);
    struct event *event = g_new0(struct event, 1);
    event->what = g_strdup(what);
    event->json = hooks_json(what, owned, g_get_real_time() / G_USEC_PER_SEC);
    event->title = hooks_title(what, owned);
    event->session = dup_detail(owned, "session");
    event->name = dup_detail(owned, "name");
    event->device = dup_detail(owned, "device");
    event->message = dup_detail(owned, "message");
    g_queue_push_tail(&hooks->waiting, event);
    if (hooks->waiting.length > HOOKS_MAX_WAITING) {
        g_warning("%d events wait for the hooks, which is the maximum: no hook is run for the "
                  "oldest event; make the hooks quicker, or reduce time_limit_s in hooks.conf",
                  HOOKS_MAX_WAITING);
        event_free(g_queue_pop_head(&hooks->waiting));
    }
    next(hooks);
}

gboolean hooks_is_idle(const Hooks *hooks) {
    return !hooks->event && hooks->waiting.length == 0;
}
