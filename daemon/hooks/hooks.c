#include "hooks.h"

#include <libsoup/soup.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/input_file.h"
#include "hooks_child.h"

#define MOST_TOKEN  4096 /* bytes of its file */
#define MOST_WAIT_S 3600 /* from one attempt of a post to the next */

struct event {
    char *what, *json, *title, *text, *session, *name, *device, *message;
};

/* Something to do for an event: a program, or a post. */
struct delivery {
    Hooks *hooks;
    char **argv; /* NULL: a post */
    char *input; /* of the program, or what is posted */
    double limit_s;
    const struct hooks_webhook *webhook;
    int failed;    /* attempts of a post */
    guint wait_id; /* while it waits for the next one */
};

struct Hooks {
    const struct hooks_conf *conf;
    struct event *event; /* at work; NULL: none */
    GQueue waiting;      /* of struct event, the oldest first */
    GQueue deliveries;   /* of struct delivery, for the event at work; and posts tried again */
    GQueue later;        /* of struct delivery: posts that failed, each with a timer */
    gboolean busy;       /* the first of them is under way */
    GCancellable *cancellable;
    SoupSession *http;
    guint deadline_id; /* of a post */
    gboolean late;
};

static void event_free(gpointer data) {
    struct event *event = data;
    char *const strings[] = {event->what,    event->json, event->title,  event->text,
                             event->session, event->name, event->device, event->message};
    for (gsize i = 0; i < G_N_ELEMENTS(strings); i++)
        g_free(strings[i]);
    g_free(event);
}

static void delivery_free(gpointer data) {
    struct delivery *delivery = data;
    g_clear_handle_id(&delivery->wait_id, g_source_remove);
    g_strfreev(delivery->argv);
    g_free(delivery->input);
    g_free(delivery);
}

/* Returns whether only root, or this program's user, could have put the executable there. */
static gboolean is_trusted(const char *path, const struct stat *info) {
    if ((info->st_uid == 0 || info->st_uid == geteuid()) && !(info->st_mode & 022))
        return TRUE;
    g_warning(
        "%s is not run: it belongs to user %u and its mode is %04o; it must belong to root or to "
        "user %u, and only its owner may be able to write it",
        path, info->st_uid, (guint)info->st_mode & 07777, (guint)geteuid());
    return FALSE;
}

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static void push_executable(Hooks *hooks, const struct event *event, const char *name) {
    g_autofree char *path = g_build_filename(hooks->conf->folder, name, NULL);
    struct stat info;
    if (*name == '.' || g_str_has_suffix(name, "~") || stat(path, &info) != 0 ||
        !S_ISREG(info.st_mode) || !(info.st_mode & 0111) || !is_trusted(path, &info))
        return;
    struct delivery *delivery = g_new0(struct delivery, 1);
    delivery->argv = g_strdupv((char *[]){path, NULL});
    delivery->input = g_strconcat(event->json, "\n", NULL);
    delivery->limit_s = hooks->conf->time_limit_s;
    g_queue_push_tail(&hooks->deliveries, delivery);
}

static void push_executables(Hooks *hooks, const struct event *event) {
    g_autoptr(GDir) dir = g_dir_open(hooks->conf->folder, 0, NULL);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    struct stat info;
    if (!dir || stat(hooks->conf->folder, &info) != 0 || !is_trusted(hooks->conf->folder, &info))
        return;
    for (const char *name; (name = g_dir_read_name(dir));)
        g_ptr_array_add(names, g_strdup(name));
    g_ptr_array_sort(names, by_name);
    for (guint i = 0; i < names->len; i++)
        push_executable(hooks, event, names->pdata[i]);
}

/* Headers hold ASCII alone, on one line. */
static char *header_text(const char *text) {
    g_autofree char *ascii = g_str_to_ascii(text, "C");
    g_strdelimit(ascii, "\r\n\t", ' ');
    return g_strndup(ascii, 200);
}

static void push_mail(Hooks *hooks, const struct event *event) {
    const struct hooks_mail *mail = &hooks->conf->mail;
    if (!g_strv_contains((const char *const *)mail->events, event->what))
        return;
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_autofree char *to = g_strjoinv(", ", mail->to), *subject = header_text(event->title);
    g_autofree char *to_header = header_text(to), *from_header = header_text(mail->from);
    g_ptr_array_add(argv, mail->sendmail);
    g_ptr_array_add(argv, "-i");
    g_ptr_array_add(argv, "--");
    for (char **address = mail->to; *address; address++)
        g_ptr_array_add(argv, *address);
    g_ptr_array_add(argv, NULL);
    struct delivery *delivery = g_new0(struct delivery, 1);
    delivery->argv = g_strdupv((char **)argv->pdata);
    delivery->input =
        g_strdup_printf("From: %s\nTo: %s\nSubject: %s\nMIME-Version: 1.0\n"
                        "Content-Type: text/plain; charset=utf-8\n"
                        "Content-Transfer-Encoding: 8bit\nAuto-Submitted: auto-generated\n\n"
                        "%s\n\n%s\n",
                        from_header, to_header, subject, event->title, event->text);
    delivery->limit_s = hooks->conf->time_limit_s;
    g_queue_push_tail(&hooks->deliveries, delivery);
}

static void push_webhook(Hooks *hooks, const struct event *event,
                         const struct hooks_webhook *webhook) {
    if (!g_strv_contains((const char *const *)webhook->events, event->what))
        return;
    struct delivery *delivery = g_new0(struct delivery, 1);
    delivery->hooks = hooks;
    delivery->webhook = webhook;
    delivery->input = g_strdup(event->json);
    g_queue_push_tail(&hooks->deliveries, delivery);
}

static void hooks_next(Hooks *hooks);

/* The delivery at the head has ended. Takes the error. */
static void end_delivery(Hooks *hooks, GError *error) {
    if (error)
        g_warning("%s", error->message);
    g_clear_error(&error);
    delivery_free(g_queue_pop_head(&hooks->deliveries));
    hooks->busy = FALSE;
    hooks_next(hooks);
}

static gboolean on_waited(gpointer data) {
    struct delivery *delivery = data;
    Hooks *hooks = delivery->hooks;
    delivery->wait_id = 0;
    g_queue_remove(&hooks->later, delivery);
    g_queue_push_tail(&hooks->deliveries, delivery);
    hooks_next(hooks);
    return G_SOURCE_REMOVE;
}

/* The post at the head has failed: it waits for its next attempt, if it has one. Takes the error.
 */
static void post_failed(Hooks *hooks, GError *error) {
    struct delivery *delivery = g_queue_peek_head(&hooks->deliveries);
    const struct hooks_webhook *webhook = delivery->webhook;
    if (delivery->failed >= webhook->retries) {
        if (webhook->retries > 0)
            g_prefix_error(&error, "given up after %d attempts: ", delivery->failed + 1);
        end_delivery(hooks, error);
        return;
    }
    const double wait_s = MIN(webhook->retry_s * (double)(1u << delivery->failed), MOST_WAIT_S);
    delivery->failed++;
    g_warning("%s; it is posted again in %g s, attempt %d of %d", error->message, wait_s,
              delivery->failed + 1, webhook->retries + 1);
    g_error_free(error);
    g_queue_pop_head(&hooks->deliveries);
    g_queue_push_tail(&hooks->later, delivery);
    delivery->wait_id = g_timeout_add((guint)(wait_s * 1000), on_waited, delivery);
    if (hooks->later.length > HOOKS_MOST_WAITING) {
        g_warning("%d posts wait to be tried again, which is the most: the oldest one is dropped",
                  HOOKS_MOST_WAITING);
        delivery_free(g_queue_pop_head(&hooks->later));
    }
    hooks->busy = FALSE;
    hooks_next(hooks);
}

static void on_child(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    hooks_child_finish(result, &error);
    if (g_cancellable_is_cancelled(g_task_get_cancellable(G_TASK(result))))
        g_clear_error(&error); /* the hooks are gone */
    else
        end_delivery(data, error);
}

static void run_child(Hooks *hooks, const struct delivery *delivery, const struct event *event) {
    g_auto(GStrv) environ = g_get_environ();
    const struct {
        const char *name, *value;
    } variables[] = {{"MESORIG_EVENT", event->what},
                     {"MESORIG_SESSION", event->session},
                     {"MESORIG_NAME", event->name},
                     {"MESORIG_DEVICE", event->device},
                     {"MESORIG_MESSAGE", event->message}};
    for (gsize i = 0; i < G_N_ELEMENTS(variables); i++)
        environ = g_environ_setenv(environ, variables[i].name, variables[i].value, TRUE);
    environ = g_environ_unsetenv(environ, "NOTIFY_SOCKET");
    hooks_child_run((const char *const *)delivery->argv, (const char *const *)environ,
                    delivery->input, delivery->limit_s, hooks->cancellable, on_child, hooks);
}

static gboolean on_deadline(gpointer data) {
    Hooks *hooks = data;
    const struct delivery *delivery = g_queue_peek_head(&hooks->deliveries);
    hooks->deadline_id = 0;
    hooks->late = TRUE;
    soup_session_abort(hooks->http);
    g_debug("%s took too long", delivery->webhook->name);
    return G_SOURCE_REMOVE;
}

static void on_posted(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    SoupMessage *message = soup_session_get_async_result_message(SOUP_SESSION(source), result);
    const guint status = soup_message_get_status(message);
    g_autofree char *reason = g_strdup(soup_message_get_reason_phrase(message));
    g_autoptr(GInputStream) answer = soup_session_send_finish(SOUP_SESSION(source), result, &error);
    Hooks *hooks = data;
    /* hooks_free() has cancelled the call, and hooks no longer exists; only the source, the HTTP
     * session, still does. */
    if (g_object_get_data(source, "gone")) {
        g_clear_error(&error);
        return;
    }
    const struct delivery *delivery = g_queue_peek_head(&hooks->deliveries);
    g_clear_handle_id(&hooks->deadline_id, g_source_remove);
    if (hooks->late) {
        g_clear_error(&error);
        error = g_error_new(G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                            "webhook %s: %s has not answered within %g s", delivery->webhook->name,
                            delivery->webhook->url, delivery->webhook->time_limit_s);
    } else if (error) {
        g_prefix_error(&error, "webhook %s: %s: ", delivery->webhook->name, delivery->webhook->url);
    } else if (!SOUP_STATUS_IS_SUCCESSFUL(status)) {
        error = g_error_new(G_IO_ERROR, G_IO_ERROR_FAILED, "webhook %s: %s has answered %u (%s)",
                            delivery->webhook->name, delivery->webhook->url, status,
                            reason ? reason : "");
    }
    hooks->late = FALSE;
    (error ? post_failed : end_delivery)(hooks, error);
}

static void run_post(Hooks *hooks, const struct delivery *delivery) {
    const struct hooks_webhook *webhook = delivery->webhook;
    g_autoptr(SoupMessage) message = soup_message_new("POST", webhook->url);
    g_autoptr(GBytes) body = g_bytes_new(delivery->input, strlen(delivery->input));
    GError *error = NULL;
    g_autofree char *token = message && *webhook->token_file
                                 ? input_file_read_text(webhook->token_file, MOST_TOKEN, &error)
                                 : NULL;
    if (!message || error) {
        if (!error)
            error = g_error_new(G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                                "%s is not an address to post to", webhook->url);
        g_prefix_error(&error, "webhook %s: ", webhook->name);
        (message ? post_failed : end_delivery)(hooks, error);
        return;
    }
    if (token) {
        token[strcspn(token, "\r\n")] = '\0';
        g_autofree char *bearer = g_strconcat("Bearer ", token, NULL);
        soup_message_headers_replace(soup_message_get_request_headers(message), "Authorization",
                                     bearer);
    }
    soup_message_add_flags(message, SOUP_MESSAGE_NO_REDIRECT);
    soup_message_set_request_body_from_bytes(message, "application/json", body);
    hooks->deadline_id = g_timeout_add((guint)(webhook->time_limit_s * 1000), on_deadline, hooks);
    soup_session_send_async(hooks->http, message, G_PRIORITY_DEFAULT, hooks->cancellable, on_posted,
                            hooks);
}

static void push_all(Hooks *hooks, const struct event *event) {
    const GArray *webhooks = hooks->conf->webhooks;
    push_executables(hooks, event);
    if (hooks->conf->mails)
        push_mail(hooks, event);
    for (guint i = 0; i < webhooks->len; i++)
        push_webhook(hooks, event, &g_array_index(webhooks, struct hooks_webhook, i));
}

/* Begins the next delivery, of the next event if there is none. */
static void hooks_next(Hooks *hooks) {
    if (hooks->busy)
        return;
    while (g_queue_is_empty(&hooks->deliveries)) {
        g_clear_pointer(&hooks->event, event_free);
        hooks->event = g_queue_pop_head(&hooks->waiting);
        if (!hooks->event)
            return;
        push_all(hooks, hooks->event);
    }
    const struct delivery *delivery = g_queue_peek_head(&hooks->deliveries);
    hooks->busy = TRUE;
    if (delivery->argv)
        run_child(hooks, delivery, hooks->event);
    else
        run_post(hooks, delivery);
}

Hooks *hooks_new(const struct hooks_conf *conf) {
    Hooks *hooks = g_new0(Hooks, 1);
    hooks->conf = conf;
    hooks->cancellable = g_cancellable_new();
    hooks->http = soup_session_new_with_options("user-agent", "mesorig-hooks", NULL);
    g_queue_init(&hooks->waiting);
    g_queue_init(&hooks->deliveries);
    g_queue_init(&hooks->later);
    return hooks;
}

void hooks_free(Hooks *hooks) {
    if (!hooks)
        return;
    if (hooks->later.length > 0)
        g_warning("%u %s waited to be tried again and will not be", hooks->later.length,
                  hooks->later.length == 1 ? "post" : "posts");
    g_object_set_data(G_OBJECT(hooks->http), "gone", hooks);
    g_clear_handle_id(&hooks->deadline_id, g_source_remove);
    g_cancellable_cancel(hooks->cancellable);
    g_clear_pointer(&hooks->event, event_free);
    g_queue_clear_full(&hooks->waiting, event_free);
    g_queue_clear_full(&hooks->deliveries, delivery_free);
    g_queue_clear_full(&hooks->later, delivery_free);
    g_object_unref(hooks->cancellable);
    g_object_unref(hooks->http);
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
    event->text = hooks_text(what, owned);
    event->session = dup_detail(owned, "session");
    event->name = dup_detail(owned, "name");
    event->device = dup_detail(owned, "device");
    event->message = dup_detail(owned, "message");
    g_queue_push_tail(&hooks->waiting, event);
    if (hooks->waiting.length > HOOKS_MOST_WAITING) {
        g_warning("%d events wait, which is the most: the oldest one is dropped",
                  HOOKS_MOST_WAITING);
        event_free(g_queue_pop_head(&hooks->waiting));
    }
    hooks_next(hooks);
}

gboolean hooks_is_idle(const Hooks *hooks) {
    return !hooks->event && hooks->waiting.length == 0 && hooks->deliveries.length == 0 &&
           hooks->later.length == 0;
}
