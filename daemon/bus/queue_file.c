/*
 * The file of the queue, in GKeyFile syntax. The section [queue] has version, next and paused. Then
 * there is a section [session N] for each session, in the order of the queue.
 */
#include "queue_private.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/input_file.h"
#include "base/new_file.h"

#define VERSION    1
#define MAX_GROUPS 1024

/* The fields of a session that are written and read in the same way: all except state, uid and
 * groups. All of them must exist in a file. */
enum kind { TEXT, BOOLEAN, INT, INT64, DOUBLE };
static const struct field {
    const char *key;
    enum kind kind;
    gsize offset;
} fields[] = {
#define FIELD(key, kind)                                                                           \
    { #key, kind, G_STRUCT_OFFSET(struct queue_item, key) }
    FIELD(name, TEXT),
    FIELD(session_path, TEXT),
    FIELD(session_text, TEXT),
    FIELD(directory, TEXT),
    FIELD(rig, TEXT),
    FIELD(calibration, TEXT),
    FIELD(calibration_text, TEXT),
    FIELD(prompt, TEXT),
    FIELD(chosen, TEXT),
    FIELD(message, TEXT),
    FIELD(predicted_s, DOUBLE),
    FIELD(bytes, INT64),
    FIELD(starts, INT),
    FIELD(process, BOOLEAN),
    FIELD(yes, BOOLEAN),
    FIELD(begun_at_s, INT64),
    FIELD(ended_at_s, INT64),
    FIELD(has_caller, BOOLEAN),
#undef FIELD
};

static void put_field(GKeyFile *to, const char *group, const struct field *field,
                      const struct queue_item *item) {
    gconstpointer at = G_STRUCT_MEMBER_P(item, field->offset);
    if (field->kind == TEXT)
        g_key_file_set_string(to, group, field->key, *(char *const *)at);
    else if (field->kind == BOOLEAN)
        g_key_file_set_boolean(to, group, field->key, *(const gboolean *)at);
    else if (field->kind == INT)
        g_key_file_set_integer(to, group, field->key, *(const int *)at);
    else if (field->kind == INT64)
        g_key_file_set_int64(to, group, field->key, *(const gint64 *)at);
    else
        g_key_file_set_double(to, group, field->key, *(const double *)at);
}

static gboolean take_field(GKeyFile *from, const char *group, const struct field *field,
                           struct queue_item *item, GError **error) {
    gpointer at = G_STRUCT_MEMBER_P(item, field->offset);
    GError *why = NULL;
    if (field->kind == TEXT) {
        char *text = g_key_file_get_string(from, group, field->key, &why);
        if (text) {
            g_free(*(char **)at);
            *(char **)at = text;
        }
    } else if (field->kind == BOOLEAN) {
        *(gboolean *)at = g_key_file_get_boolean(from, group, field->key, &why);
    } else if (field->kind == INT) {
        *(int *)at = g_key_file_get_integer(from, group, field->key, &why);
    } else if (field->kind == INT64) {
        *(gint64 *)at = g_key_file_get_int64(from, group, field->key, &why);
    } else {
        *(double *)at = g_key_file_get_double(from, group, field->key, &why);
    }
    if (why)
        g_propagate_error(error, why);
    return !why;
}

/* Reads the user who has added the session, and the numbers of the user's groups. */
static gboolean take_caller(GKeyFile *from, const char *group, struct queue_item *item,
                            GError **error) {
    g_autoptr(GError) why = NULL;
    gsize n = 0;
    const guint64 uid = g_key_file_get_uint64(from, group, "uid", &why);
    g_autofree int *groups =
        why ? NULL : g_key_file_get_integer_list(from, group, "groups", &n, &why);
    if (why || uid > G_MAXUINT32 || n > MAX_GROUPS) {
        if (why)
            g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA, "[%s] uid or groups: %s", group,
                        why->message);
        else if (uid > G_MAXUINT32)
            g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                        "[%s] uid: %" G_GUINT64_FORMAT " is larger than %u", group, uid,
                        G_MAXUINT32);
        else
            g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                        "[%s] groups: %zu groups are more than the maximum of %d", group, n,
                        MAX_GROUPS);
        return FALSE;
    }
    item->uid = (guint32)uid;
    for (gsize i = 0; i < n; i++) {
        const guint32 id = (guint32)groups[i];
        g_array_append_val(item->groups, id);
    }
    return TRUE;
}

/* Reads the state. If the session had begun when the program ended, the session waits again, at the
 * same place of the queue. */
static gboolean take_state(GKeyFile *from, const char *group, struct queue_item *item,
                           GError **error) {
    g_autofree char *name = g_key_file_get_string(from, group, "state", error);
    if (!name)
        return FALSE;
    for (int i = 0; i < QUEUE_STATES; i++)
        if (strcmp(name, queue_state_names[i]) == 0) {
            item->state = i < QUEUE_DONE ? QUEUE_WAITING : (enum queue_state)i;
            return TRUE;
        }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                "[%s] state: there is no state “%s”; choose from waiting, done and stopped", group,
                name);
    return FALSE;
}

static gboolean take_item(Queue *queue, GKeyFile *from, const char *group, GError **error) {
    g_autoptr(QueueItem) item = queue_item_new();
    char *end = NULL;
    const guint64 id = g_str_has_prefix(group, "session ")
                           ? g_ascii_strtoull(group + strlen("session "), &end, 10)
                           : 0;
    if (id < 1 || id >= queue->next_id || *end) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
            "there is no section [%s]: sections are [queue] and [session N], with N from 1 to %u",
            group, queue->next_id - 1);
        return FALSE;
    }
    if (queue->items->len >= QUEUE_MAX) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "[%s] exceeds the maximum of %d sessions", group, QUEUE_MAX);
        return FALSE;
    }
    item->id = (guint)id;
    for (gsize i = 0; i < G_N_ELEMENTS(fields); i++)
        if (!take_field(from, group, &fields[i], item, error))
            return FALSE;
    if (!take_state(from, group, item, error) || !take_caller(from, group, item, error))
        return FALSE;
    const gboolean has_directory = g_path_is_absolute(item->directory);
    if (!has_directory || !g_path_is_absolute(item->session_path)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "[%s] %s: “%s” is not an absolute path", group,
                    has_directory ? "session_path" : "directory",
                    has_directory ? item->session_path : item->directory);
        return FALSE;
    }
    if (!(item->predicted_s >= 0)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "[%s] predicted_s: %g is not at least 0", group, item->predicted_s);
        return FALSE;
    }
    if (item->starts < 0) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA, "[%s] starts: %d is below 0", group,
                    item->starts);
        return FALSE;
    }
    g_ptr_array_add(queue->items, g_steal_pointer(&item));
    return TRUE;
}

static gboolean take_text(Queue *queue, const char *text, gsize length, GError **error) {
    g_autoptr(GKeyFile) from = g_key_file_new();
    if (!g_key_file_load_from_data(from, text, length, G_KEY_FILE_NONE, error))
        return FALSE;
    if (g_key_file_get_integer(from, "queue", "version", NULL) != VERSION) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "[queue] version is not %d: the file is damaged, or another version of "
                    "mesorigd has written it",
                    VERSION);
        return FALSE;
    }
    const guint64 next = g_key_file_get_uint64(from, "queue", "next", NULL);
    queue->next_id = (guint)CLAMP(next, 1, G_MAXUINT - 1);
    queue->paused = g_key_file_get_string(from, "queue", "paused", NULL);
    g_auto(GStrv) groups = g_key_file_get_groups(from, NULL);
    for (char **group = groups; *group; group++)
        if (strcmp(*group, "queue") != 0 && !take_item(queue, from, *group, error))
            return FALSE;
    return TRUE;
}

/* Opens the file for reading and returns its descriptor. Returns −1 without an error if there is no
 * file. Returns −1 with an error if the file cannot be used, for instance because another user
 * could have written it. */
static int open_own(const char *path, gsize *ret_length, GError **error) {
    const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    struct stat info;
    if (fd < 0 && errno == ENOENT)
        return -1;
    if (fd < 0 || fstat(fd, &info) != 0) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "the queue's file cannot be opened: %s", g_strerror(errno));
    } else if (!S_ISREG(info.st_mode)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "the path leads to %s, not to a file", input_file_kind(info.st_mode));
    } else if (info.st_uid != geteuid() || (info.st_mode & 022)) {
        g_set_error(
            error, G_IO_ERROR, G_IO_ERROR_PERMISSION_DENIED,
            "other users could have written this file: it belongs to user %u and has mode %04o, "
            "but must belong to the user of mesorigd, and only that user may write to it",
            info.st_uid, (guint)info.st_mode & 07777);
    } else if (info.st_size > QUEUE_MAX_BYTES) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "the file is larger than %d MiB, the maximum for a queue",
                    QUEUE_MAX_BYTES >> 20);
    } else {
        *ret_length = (gsize)info.st_size;
        return fd;
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

gboolean queue_file_read(Queue *queue, GError **error) {
    GError *why = NULL;
    gsize length = 0;
    const int fd = open_own(queue->path, &length, &why);
    if (fd >= 0) {
        g_autofree char *text = g_malloc(length + 1);
        if (input_file_read_at(fd, queue->path, text, length, 0, &why)) {
            text[length] = '\0';
            take_text(queue, text, length, &why);
        }
        close(fd);
    }
    if (why) {
        g_prefix_error(&why, "%s: ", queue->path);
        g_propagate_error(error, why);
    }
    return !why;
}

static char *queue_text(const Queue *queue, gsize *ret_length) {
    g_autoptr(GKeyFile) to = g_key_file_new();
    g_key_file_set_comment(
        to, NULL, NULL, " Written by mesorigd, and read when it starts: see mesorig queue.", NULL);
    g_key_file_set_integer(to, "queue", "version", VERSION);
    g_key_file_set_uint64(to, "queue", "next", queue->next_id);
    if (queue->paused)
        g_key_file_set_string(to, "queue", "paused", queue->paused);
    for (guint i = 0; i < queue->items->len; i++) {
        const struct queue_item *item = queue->items->pdata[i];
        g_autofree char *group = g_strdup_printf("session %u", item->id);
        g_key_file_set_string(to, group, "state", queue_state_names[item->state]);
        for (gsize k = 0; k < G_N_ELEMENTS(fields); k++)
            put_field(to, group, &fields[k], item);
        g_key_file_set_uint64(to, group, "uid", item->uid);
        static int none;
        g_key_file_set_integer_list(to, group, "groups",
                                    item->groups->len ? (int *)(void *)item->groups->data : &none,
                                    item->groups->len);
    }
    return g_key_file_to_data(to, ret_length, NULL);
}

gboolean queue_file_write(const Queue *queue, GError **error) {
    struct new_file file;
    gsize length = 0;
    g_autofree char *text = queue_text(queue, &length);
    if (length > QUEUE_MAX_BYTES) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NO_SPACE,
                    "the queue's file would exceed its limit of %d MiB: wait until sessions have "
                    "ended, and remove them",
                    QUEUE_MAX_BYTES >> 20);
        return FALSE;
    }
    gboolean ok = new_file_begin(&file, queue->folder, queue->name);
    if (ok && (fchmod(file.fd, 0600) != 0 || !new_file_put(&file, text, length))) {
        new_file_abandon(&file);
        ok = FALSE;
    } else if (ok) {
        ok = new_file_commit(&file, TRUE);
    }
    if (!ok)
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "%s: cannot be written: %s; the file keeps its old contents: check the free "
                    "space and the rights of its folder",
                    queue->path, g_strerror(errno));
    return ok;
}
